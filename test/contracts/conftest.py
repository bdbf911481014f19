"""The contracts are held to by every registered part: a test that takes one of these names runs once for each entry.

Entries are read from the registries when tests are collected. A new part needs no line here.
"""

from __future__ import annotations

from typing import NamedTuple

import pytest
from registered_targets import target_files

from fisheye_ep_calib.camera import LENS_EXTRAS, LENSES, PUPIL_FAMILIES
from fisheye_ep_calib.camera.extras import HELD_EXTRAS
from fisheye_ep_calib.camera.lenses import HELD_LENSES
from fisheye_ep_calib.formats import FORMATS
from fisheye_ep_calib.rectification.projections import PROJECTIONS
from fisheye_ep_calib.storage.sources.find import BAG_FORMATS
from fisheye_ep_calib.target import Target, parse_target
from fisheye_ep_calib.target.registry import TARGETS

REGISTRIES = {
    "pupil_name": PUPIL_FAMILIES,
    "lens_name": LENSES,
    "extra_name": LENS_EXTRAS,
    "format_name": FORMATS,
    "written_format": {name: one for name, one in FORMATS.items() if one.write and not one.places_only},
    "held_lens": HELD_LENSES,
    "held_extra": HELD_EXTRAS,
    "target_kind": TARGETS,
    "bag_suffix": BAG_FORMATS,
    "projection_name": PROJECTIONS,
}
SHAPES = [(), (5,), (3, 4), (0,), (2, 0)]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    for name, registry in REGISTRIES.items():
        if name in metafunc.fixturenames:
            metafunc.parametrize(name, list(registry), scope="session")
    if "board" in metafunc.fixturenames:  # a kind of target, and a file of it
        boards = [(kind, name) for kind in TARGETS for name in target_files(kind)]
        metafunc.parametrize("board", boards, ids="-".join, scope="session", indirect=True)
    if "shape" in metafunc.fixturenames:
        metafunc.parametrize("shape", SHAPES, ids=str)


class Board(NamedTuple):
    """A target and the keys of its file."""

    target: Target
    keys: dict


@pytest.fixture(scope="session")
def board(request) -> Board:
    kind, name = request.param
    keys = target_files(kind)[name]
    return Board(parse_target(keys, f"{name}.yaml", name), keys)
