"""A camera's parameters as one vector: their order, names and units."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from fisheye_ep_calib.camera.extras import KNOWN_EXTRAS
from fisheye_ep_calib.camera.lenses import KNOWN_LENSES

PIXEL_NAMES = ("fx", "fy", "skew", "cx", "cy")


@dataclass(frozen=True)
class ParameterLayout:
    """names (P,), units (P,): "px" of the pixel grid, "m" of the pupil, else "". slices: of each block.

    Blocks in their order: "pixels", "radial" (the lens), each extra in use by its name, "coefficients" (the pupil).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    slices: dict[str, slice]


def pupil_names(terms: int) -> tuple[str, ...]:
    """Names of E(θ)'s coefficients: e1, e2, …"""
    return tuple(f"e{term + 1}" for term in range(terms))


def parameter_layout(lens: str, extras: tuple[str, ...], terms: int) -> ParameterLayout:
    """Of a camera with a lens, extras in use (keys of the registries, in their order) and terms of E(θ)."""
    of_extras = tuple((name, tuple(KNOWN_EXTRAS[name].coefficient_names)) for name in extras)
    return _layout(tuple(KNOWN_LENSES[lens].coefficient_names), of_extras, terms)


@lru_cache(maxsize=256)
def _layout(
    of_lens: tuple[str, ...], of_extras: tuple[tuple[str, tuple[str, ...]], ...], terms: int
) -> ParameterLayout:
    blocks = {"pixels": PIXEL_NAMES, "radial": of_lens, **dict(of_extras), "coefficients": pupil_names(terms)}
    unit_of = {"pixels": "px", "coefficients": "m"}
    names: list[str] = []
    units: list[str] = []
    slices: dict[str, slice] = {}
    for block, block_names in blocks.items():
        slices[block] = slice(len(names), len(names) + len(block_names))
        names += block_names
        units += [unit_of.get(block, "")] * len(block_names)
    return ParameterLayout(tuple(names), tuple(units), slices)
