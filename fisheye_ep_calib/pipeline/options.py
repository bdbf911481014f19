"""The options that the engine takes by name, and what is said where one is unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from difflib import get_close_matches
from typing import Any

from fisheye_ep_calib.calibration import Options
from fisheye_ep_calib.calibration.options import base_structure
from fisheye_ep_calib.camera import LENS_EXTRAS
from fisheye_ep_calib.errors import InputError

PASSES = (1, 2)
LOOK_OPTIONS = ("max_views", "every", "strict")


def fit_options() -> tuple[str, ...]:
    """Those of ``Options.of``: its fields, and a switch for each lens extra that is registered."""
    return (*(field.name for field in fields(Options) if field.name != "extras"), *LENS_EXTRAS)


def check_fit(model: str, passes: int, options: Mapping[str, Any]) -> None:
    """Raises InputError before anything is looked at."""
    if passes not in PASSES:
        raise InputError(f"`passes` must be 1 or 2, not {passes}")
    refuse_unknown_options(options, fit_options())
    base_structure(Options.of(**options), model)


def refuse_unknown_options(options: Mapping[str, Any], names: tuple[str, ...]) -> None:
    """Raises InputError that lists the known options and names the one that was probably meant."""
    for name in options:
        if name not in names:
            meant = get_close_matches(name, names, 1)
            hint = f"did you mean {meant[0]}? " if meant else ""
            raise InputError(f"unknown option {name!r}; {hint}known: {', '.join(sorted(names))}")
