"""What a calibration starts from: which point of the target was seen where, in which image."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np
import numpy.typing as npt

from fisheye_ep_calib.calibration.observation_keys import (
    OPTIONAL,
    REQUIRED,
    check_density,
    check_points,
    check_weights,
    checked_keys,
    real_numbers,
    whole_numbers,
)
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.npz_file import read_npz
from fisheye_ep_calib.target.shape.measured import BoardShape

_MOST_IMAGES = 10**7  # every number up to the largest gets a name


@dataclass(frozen=True)
class Observations:
    """M sightings of the n points of one target in V images of one camera.

    object_points (n, 3): metres, target frame.
    image_index (M,), point_index (M,): int, which image saw which point; rows are sorted by image.
    pixels (M, 2): measured positions; the centre of the top-left pixel is (0, 0).
    image_size: (width, height) in pixels.
    weights (M,): multiply the residuals; 0 excludes a sighting from the fit.
    image_names: one name an image (V of them).
    split: (V,) str such as "train" and "test", or None.
    disc_radius: metres, where the features are centres of gravity of projected discs; else None.
    board: the target's shape where it was measured before.
    mistakable: whether a view may count the points from another corner, or some rows on: those of a plain lattice.
    """

    object_points: np.ndarray
    image_index: np.ndarray
    point_index: np.ndarray
    pixels: np.ndarray
    image_size: tuple[int, int]
    weights: np.ndarray
    image_names: tuple[str, ...]
    split: np.ndarray | None = None
    disc_radius: float | None = None
    board: BoardShape | None = None
    mistakable: bool = False

    @staticmethod
    def create(
        object_points: npt.ArrayLike,
        image_index: npt.ArrayLike,
        point_index: npt.ArrayLike,
        pixels: npt.ArrayLike,
        image_size: npt.ArrayLike,
        weights: npt.ArrayLike | None = None,
        image_names: Iterable[object] | None = None,
        split: Iterable[object] | None = None,
        disc_radius: float | None = None,
        board: BoardShape | None = None,
        mistakable: bool = False,
    ) -> Observations:
        """Validate, sort by image and fill in what is optional. Raises InputError."""
        # To the picometre, so that lengths given in mm and in m are the same numbers.
        object_points = np.round(real_numbers("object_points", object_points), 12)
        image_index = whole_numbers("image_index", image_index).reshape(-1)
        point_index = whole_numbers("point_index", point_index).reshape(-1)
        pixels = real_numbers("pixels", pixels)
        _check_shapes(object_points, image_index, point_index, pixels)
        size = _checked_size(image_size)
        _check_inside(pixels, image_index, size)
        check_density(len(np.unique(image_index)), len(object_points), len(pixels))
        pair = image_index * len(object_points) + point_index
        if len(np.unique(pair)) != len(pair):
            raise InputError("an image lists the same point twice")
        weights = np.ones(len(pixels)) if weights is None else real_numbers("weights", weights).reshape(-1)
        check_weights(weights)
        if weights.shape != (len(pixels),) or not np.isfinite(weights).all() or (weights < 0).any():
            raise InputError("weights must be finite, not negative, one an observation")
        image_names = _checked_names(image_names, int(image_index.max()) + 1)
        if split is not None:
            split = np.array(split).astype(str).reshape(-1)
            if len(split) != len(image_names):
                raise InputError("split must have one entry an image")
        if disc_radius is not None and not (np.isfinite(disc_radius) and disc_radius > 0):
            raise InputError("disc_radius must be positive")
        if board is not None and not board.same_target(object_points):
            raise InputError("the board's measured shape belongs to another target")
        order = np.argsort(image_index, kind="stable")
        return Observations(
            object_points,
            image_index[order],
            point_index[order],
            pixels[order],
            size,
            weights[order],
            image_names,
            split,
            None if disc_radius is None else float(disc_radius),
            board,
            bool(mistakable),
        )

    @staticmethod
    def load(path: str | PathLike[str]) -> Observations:
        """Read an observation file (.npz); lengths become metres. Raises InputError with the path and what is wrong."""
        arrays = read_npz(path, REQUIRED, OPTIONAL, "an observation file")
        try:
            return Observations.create(**checked_keys(arrays))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def with_board(self, board: BoardShape | None) -> Observations:
        """Of a target whose shape was measured, where the observations do not bring one themselves."""
        if board is None or self.board is not None or not board.same_target(self.object_points):
            return self
        return replace(self, board=board)

    @property
    def view_count(self) -> int:
        """Images with at least one sighting of non-zero weight."""
        return len(np.unique(self.image_index[self.weights > 0]))

    def rows_of(self, images: npt.ArrayLike) -> list[slice]:
        """The rows of each of these images (V,): rows are sorted by image."""
        first = np.searchsorted(self.image_index, images, side="left").tolist()
        return list(map(slice, first, np.searchsorted(self.image_index, images, side="right").tolist()))

    def select_images(self, images: np.ndarray) -> Observations:
        """Only the sightings in these images; image numbers and names stay."""
        keep = np.isin(self.image_index, images)
        return replace(
            self,
            image_index=self.image_index[keep],
            point_index=self.point_index[keep],
            pixels=self.pixels[keep],
            weights=self.weights[keep],
        )


def _check_shapes(
    object_points: np.ndarray, image_index: np.ndarray, point_index: np.ndarray, pixels: np.ndarray
) -> None:
    """Refuse arrays that are not of one length, that are empty, not finite, or name points that are not there."""
    count = len(image_index)
    if object_points.ndim != 2 or object_points.shape[1] != 3 or not np.isfinite(object_points).all():
        raise InputError("object_points must be finite and of shape (n, 3)")
    check_points(object_points)
    if pixels.shape != (count, 2) or point_index.shape != (count,):
        raise InputError("image_index, point_index and pixels must have one row an observation")
    if count == 0:
        raise InputError("there are no observations")
    if not np.isfinite(pixels).all():
        bad = int(np.flatnonzero(~np.isfinite(pixels).all(axis=1))[0])
        raise InputError(f"observation {bad} (image {image_index[bad]}) has a pixel that is not finite")
    if point_index.min() < 0 or point_index.max() >= len(object_points):
        raise InputError(f"point_index must lie in 0..{len(object_points) - 1}")
    if image_index.min() < 0:
        raise InputError("image_index must not be negative")


def _checked_size(image_size: npt.ArrayLike) -> tuple[int, int]:
    size = whole_numbers("image_size", image_size).reshape(-1)
    if len(size) != 2 or (size <= 0).any():
        raise InputError("image_size must be positive: width and height in pixels")
    return int(size[0]), int(size[1])


def _check_inside(pixels: np.ndarray, image_index: np.ndarray, size: tuple[int, int]) -> None:
    outside = (pixels < -0.5).any(axis=1) | (pixels > np.array(size) - 0.5).any(axis=1)
    if outside.any():
        bad = int(np.flatnonzero(outside)[0])
        raise InputError(f"observation {bad} (image {image_index[bad]}) lies outside the {size[0]}×{size[1]} image")


def _checked_names(names: Iterable[object] | None, images: int) -> tuple[str, ...]:
    """One name an image: those given, or the images' numbers."""
    if names is None:
        if images > _MOST_IMAGES:
            raise InputError(f"image_index has {images - 1}: number the images from 0, without large gaps")
        names = range(images)
    names = tuple(str(name) for name in names)
    if len(names) < images:
        raise InputError("image_names is shorter than the images that image_index counts")
    return names
