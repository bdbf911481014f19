"""A value of the wrong kind anywhere in a file is refused in this package's words, never in Python's or NumPy's."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from known_scenes import CAMERA

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.file_values import matrix, number, numbers
from fisheye_ep_calib.storage.camera_file import read_camera_file, save_camera
from fisheye_ep_calib.storage.rig_file import load_rig, places_yaml

WRONG = [[[1.0, 2.0], [3.0]], "word", None, float("nan"), True, {}, [None], [1e308] * 4]
GONE = object()
NOT_OURS = re.compile(
    "numpy|inhomogeneous|reshape|array element|convert|dtype|object is|attribute|argument|unpack|subscript|indices|"
    "NoneType|unhashable|Error|broadcast|literal|out of range",
)
MATRIX = {"rows": 3, "cols": 3, "data": [300.0, 0.0, 320.0, 0.0, 300.0, 240.0, 0.0, 0.0, 1.0]}
CAMERA_INFO = {
    "image_width": 640,
    "image_height": 480,
    "camera_name": "front",
    "camera_matrix": MATRIX,
    "distortion_model": "plumb_bob",
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.1, 0.0, 0.0, 0.0, 0.0]},
}
KALIBR = {
    "cam0": {
        "camera_model": "ds",
        "distortion_coeffs": [],
        "distortion_model": "none",
        "intrinsics": [-0.2, 0.5, 300.0, 300.0, 320.0, 240.0],
        "resolution": [640, 480],
    }
}
MRCAL = {"lensmodel": "LENSMODEL_OPENCV4", "intrinsics": [300.0, 300, 320, 240, 0.1, 0, 0, 0], "imagersize": [640, 480]}
OPENCV = {
    "image_width": 640,
    "image_height": 480,
    "fisheye_model": 1,
    "camera_matrix": MATRIX,
    "distortion_coefficients": {"rows": 4, "cols": 1, "data": [0.1, 0.0, 0.0, 0.0]},
}


def own_camera() -> Any:
    path = Path("own.yaml")
    save_camera(path, CAMERA)
    return yaml.safe_load(path.read_text())


def rig() -> Any:
    content = yaml.safe_load(places_yaml({"a": np.eye(4), "b": np.eye(4)}))
    return {**content, "overlaps": [{"cameras": ["a", "b"]}]}


def opencv_text(content: Any) -> str:
    text = yaml.safe_dump(content, default_flow_style=None, sort_keys=False)
    return "%YAML:1.0\n---\n" + re.sub(r"^(\w+):(?=\n  \w)", r"\1: !!opencv-matrix", text, flags=re.MULTILINE)


FILES: dict[str, tuple[Callable[[], Any], Callable[[Any], str], Callable[[Path], object]]] = {
    "own camera": (own_camera, yaml.safe_dump, read_camera_file),
    "rig": (rig, yaml.safe_dump, load_rig),
    "camera_info": (lambda: CAMERA_INFO, yaml.safe_dump, read_camera_file),
    "kalibr": (lambda: KALIBR, yaml.safe_dump, read_camera_file),
    "mrcal": (lambda: MRCAL, repr, read_camera_file),
    "opencv": (lambda: OPENCV, opencv_text, read_camera_file),
}


def places(content: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Of every value, and of lists the first."""
    if place:
        yield place
    inside = (
        content.items() if isinstance(content, dict) else enumerate(content[:1]) if isinstance(content, list) else ()
    )
    for key, value in inside:
        yield from places(value, (*place, key))


def changed(content: Any, place: tuple[Any, ...], value: Any) -> Any:
    content = copy.deepcopy(content)
    inside = content
    for key in place[:-1]:
        inside = inside[key]
    if value is GONE:
        del inside[place[-1]]
    else:
        inside[place[-1]] = value
    return content


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of what lies beyond all bounds; commands keep it to themselves
def test_a_wrong_value_anywhere(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    make, text_of, read = FILES[kind]
    content, path, refused = make(), tmp_path / "given", 0
    path.write_text(text_of(content))
    read(path)
    for place in places(content):
        for value in [*WRONG, GONE]:
            path.write_text(text_of(changed(content, place, value)))
            try:
                read(path)
            except InputError as error:
                refused += 1
                told = re.sub(r"'[^']*'", "", str(error).replace(str(path), ""))
                assert not NOT_OURS.search(told), f"{place} = {value!r}: {error}"
                assert str(error).isprintable()
    assert refused > 20


def test_what_is_wanted_is_said() -> None:
    with pytest.raises(InputError, match=r"covariance must be 2 rows of 2 numbers, not \[\[1\], \[2, 3\]\]"):
        matrix([[1], [2, 3]], "covariance", 2, 2)
    with pytest.raises(InputError, match="intrinsics must be a list of 4 numbers, not 'word'"):
        numbers("word", "intrinsics", 4)
    with pytest.raises(InputError, match="fx must be a number, not True"):
        number(True, "fx")
    assert matrix([1, "2", 3.0, 4], "m", 2, 2).tolist() == matrix([[1, 2], [3, 4]], "m", 2, 2).tolist()
    assert number(10**400, "fx") == np.inf and numbers((1, 2), "x") == [1.0, 2.0]
