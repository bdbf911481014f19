"""Target files with the shape that a calibration measured."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any

import yaml

from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.target.registry import SHAPE
from fisheye_ep_calib.target.shape.content import shape_content
from fisheye_ep_calib.target.shape.measured import BoardShape


def save_target(path: str | PathLike[str], keys: Mapping[str, Any], shape: BoardShape) -> None:
    """Write a target file, whole or not at all: keys as they were read, and the shape as measured."""
    content = {**keys, SHAPE: shape_content(shape)}
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True, width=1 << 16)
    atomic_write(path, text.encode())
