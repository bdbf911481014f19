"""What the user of a calibration fixes and what is left open."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import Any

import numpy as np

from fisheye_ep_calib.arguments import positive_length
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.structure import LENS, Structure
from fisheye_ep_calib.camera import LENS_EXTRAS
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import expanded
from fisheye_ep_calib.target.registry import load_shape
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shape.model import BOW, FLAT, FREE

AUTO = "auto"
PRINTED_FORM = "ep_odd_target_axis"
DISC_CENTERS = ("unbiased", "naive")
LOSSES = ("cut", "huber")
BOARD_SHAPES = (FLAT, BOW, FREE, AUTO)


@dataclass(frozen=True)
class Options:
    """What the user may fix; None leaves it to ``auto``, or to the model's own default where a model is named.

    terms: of E(θ). lens: key of LENSES. skew, board_warp: whether each is estimated. extras: the same of LENS_EXTRAS.
    board_shape: of BOARD_SHAPES, or one that was measured before and is held; ``of`` also takes a file that has it.
    disc_centers: "unbiased" predicts the centre of gravity of each projected disc, "naive" the image of its centre.
    loss: "cut" leaves out what lies beyond 6 σ of the richest model; "huber" keeps every sighting at less weight.
    flex, rolling_shutter: whether a board that changes from view to view, and a motion within each image, are
    estimated (view_effects.py).
    svp_distance: metres, for which the single-viewpoint stand-in is fitted.
    force: give back a camera that is refused for what its views leave open, with the reason in ``refused``.

    An extra that is asked for is estimated; but ``lens_field``, which passes what is wrong with a view for the lens,
    "auto" takes only where folds over views are predicted better with it.
    """

    terms: int | None = None
    lens: str | None = None
    skew: bool | None = None
    board_warp: bool | None = None
    board_shape: str | BoardShape | None = None
    disc_centers: str = "unbiased"
    loss: str = "cut"
    flex: bool = False
    rolling_shutter: bool = False
    svp_distance: float = np.inf
    force: bool = False
    extras: Mapping[str, bool | None] = field(default_factory=dict)

    @staticmethod
    def of(**given: Any) -> Options:
        """From keywords; the name of a lens extra is one too, such as ``tangential=True``."""
        extras = {name: given.pop(name) for name in LENS_EXTRAS if name in given}
        shape = given.get("board_shape")
        if isinstance(shape, str | PathLike) and shape not in BOARD_SHAPES:
            given["board_shape"] = _shape_of_file(shape)
        return Options(**given, extras=extras)

    def __post_init__(self) -> None:
        choices = (
            ("disc_centers", self.disc_centers, DISC_CENTERS),
            ("loss", self.loss, LOSSES),
        )
        for name, value, words in choices:
            if value not in words:
                raise InputError(f"unknown {name} {value!r}; known: {', '.join(words)}")
        positive_length(self.svp_distance, "svp_distance")


def base_structure(settings: Options, model: str) -> Structure:
    """What the user has fixed. Raises InputError where there is no such model, lens or number of terms."""
    tried = (LENS_FIELD.name,) if model == AUTO else ()
    extras = tuple(name for name in LENS_EXTRAS if settings.extras.get(name) and name not in tried)
    return Structure(
        {AUTO: "ep_even", PRINTED_FORM: "ep_odd"}.get(model, model),
        settings.terms,
        settings.lens or LENS,
        settings.skew is not False,
        extras,
        BOW if wanted_shape(settings, model) == BOW else FLAT,
        target_axis=model == PRINTED_FORM,
    )


def wanted_shape(settings: Options, model: str) -> str:
    """The board's shape that the user asked for; a named model takes the board as it is, "auto" looks."""
    if isinstance(settings.board_shape, BoardShape):
        return FLAT
    if settings.board_shape is not None:
        return settings.board_shape
    if settings.board_warp is not None:
        return BOW if settings.board_warp else FLAT
    return AUTO if model == AUTO else FLAT


def _shape_of_file(path: str | PathLike[str]) -> BoardShape:
    if not os.path.exists(expanded(path)):
        raise InputError(
            f"unknown board_shape {str(path)!r}; known: {', '.join(BOARD_SHAPES)}, or a file with a measured shape"
        )
    return load_shape(path)


def with_board(observations: Observations, settings: Options) -> Observations:
    """The observations with the measured shape that the user gives, which must be one of this target."""
    shape = settings.board_shape
    if not isinstance(shape, BoardShape):
        return observations
    if not shape.same_target(observations.object_points):
        raise InputError("the measured shape of `board_shape` belongs to another target than the observations")
    return replace(observations, board=shape)
