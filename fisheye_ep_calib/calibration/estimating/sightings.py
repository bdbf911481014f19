"""Observations made ready for fitting: which images have enough points for a pose, and what the target may be."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fisheye_ep_calib.calibration.estimating.prediction import FeatureModel
from fisheye_ep_calib.calibration.estimating.robust import LINEAR, Loss
from fisheye_ep_calib.calibration.estimating.view_effects import ViewEffects
from fisheye_ep_calib.calibration.estimating.views import ViewBlock, view_blocks
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.target.shape.frame import board_frame
from fisheye_ep_calib.target.shape.model import BOW, FREE, ShapeModel, bow_model, flat_model

MIN_VIEWS = 3
MIN_POINTS = 4  # sightings a view needs for its pose
_ON_A_LINE = 1e-6  # variance of a view's points across, over that along; such a view may turn about its line


@dataclass(frozen=True)
class Sightings:
    """Observations made ready for fitting. images (V,): the image numbers of the pose array.

    target: as its file has it, or as it was measured before. free: what its shape may be where it is estimated, with
    the variances of the data; None until they are known. effects: what is let differ from view to view.
    """

    observations: Observations
    images: np.ndarray
    blocks: tuple[ViewBlock, ...]
    features: FeatureModel
    target: ShapeModel
    loss: Loss = LINEAR
    free: ShapeModel | None = None
    effects: ViewEffects | None = None

    def shape_model(self, kind: str) -> ShapeModel:
        """What a structure's ``board_shape`` lets the target be."""
        if kind == FREE and self.free is not None:
            return self.free
        return bow_model(self.target) if kind == BOW else self.target

    @cached_property
    def point_count(self) -> int:
        return int(self.view_counts.sum())

    @cached_property
    def view_counts(self) -> np.ndarray:
        """Points used in each view (V,)."""
        counts = np.zeros(len(self.images), dtype=int)
        for block in self.blocks:
            counts[block.views] = (block.weights > 0).sum(axis=-1)
        return counts

    @cached_property
    def usual_weight(self) -> float:
        """What turns pixels into the unit of weighted residuals; weights may be 1/σ."""
        weights = self.observations.weights
        return float(np.median(weights[weights > 0]))


def sightings_of(observations: Observations, disc_centers: str = "unbiased") -> Sightings:
    """The images with enough sightings for a pose.

    disc_centers: "unbiased" predicts centres of gravity of projected discs, "naive" images of their centres.
    """
    images = _images_with_points(observations)
    radius = observations.disc_radius if disc_centers == "unbiased" else None
    features = FeatureModel(board_frame(observations.object_points), radius)
    board = observations.board
    target = flat_model(observations.object_points, None if board is None else board.local)
    return Sightings(observations, images, view_blocks(observations, images), features, target)


def prepare(observations: Observations, disc_centers: str = "unbiased") -> Sightings:
    """``sightings_of`` for a calibration. Raises CalibrationError where too few images remain."""
    sightings = sightings_of(observations, disc_centers)
    if len(sightings.images) < MIN_VIEWS:
        raise CalibrationError(
            f"{_count(len(sightings.images), 'view has', 'views have')} at least {MIN_POINTS} points, not on one line; "
            f"at least {MIN_VIEWS} are needed, and 20 or more for a good calibration: record more views"
        )
    return sightings


def with_weights(sightings: Sightings, weights: np.ndarray) -> Sightings:
    """The same sightings under other weights (M,); views that lose too many points are left out."""
    observations = replace(sightings.observations, weights=weights)
    images = _images_with_points(observations)
    if len(images) < MIN_VIEWS:
        raise CalibrationError(
            f"only {_count(len(images), 'view remains', 'views remain')} once wrong points are left out; "
            "check that the target file describes the board in the images"
        )
    return replace(sightings, observations=observations, images=images, blocks=view_blocks(observations, images))


def of_images(sightings: Sightings, images: np.ndarray) -> Sightings:
    """Some of the images alone; observation rows keep their places."""
    return replace(sightings, images=images, blocks=view_blocks(sightings.observations, images))


def why_no_pose(observations: Observations, image: int) -> str:
    """Why ``sightings_of`` left out an image that was observed."""
    (rows,) = observations.rows_of([image])
    count = int((observations.weights[rows] > 0).sum())
    return f"fewer than {MIN_POINTS} points" if count < MIN_POINTS else "its points lie on one line"


def _images_with_points(observations: Observations) -> np.ndarray:
    """Image numbers (V,), sorted, of the images with enough points for a pose, on one line neither on the target nor in
    the image."""
    used = observations.weights > 0
    images, view, counts = np.unique(observations.image_index[used], return_inverse=True, return_counts=True)
    points = observations.object_points[observations.point_index[used]] - observations.object_points.mean(axis=0)
    enough = counts >= MIN_POINTS
    for values in (points, observations.pixels[used] - np.array(observations.image_size) / 2):
        spread = np.linalg.eigvalsh(_scatter(values, view, counts))
        enough &= spread[:, -2] > _ON_A_LINE * spread[:, -1]
    return images[enough]


def _scatter(values: np.ndarray, view: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """The covariance (V, k, k) of the values (M, k) of each view."""
    axes = range(values.shape[1])
    middle = np.stack([np.bincount(view, values[:, i]) for i in axes], axis=-1) / counts[:, None]
    scatter = np.empty((len(counts), len(axes), len(axes)))
    for i in axes:
        for j in range(i + 1):
            products = np.bincount(view, values[:, i] * values[:, j]) / counts
            scatter[:, i, j] = scatter[:, j, i] = products - middle[:, i] * middle[:, j]
    return scatter


def _count(number: int, singular: str, plural: str) -> str:
    return f"{number} {singular if number == 1 else plural}"
