"""Exports in the programs that they are for, where these are installed."""

from __future__ import annotations

import ast
import ctypes
import ctypes.util
import json
import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from fisheye_ep_calib.calibration.assessing.stand_in import loss_px, points_over_image
from fisheye_ep_calib.camera import FAR, FisheyeCamera
from fisheye_ep_calib.formats import FORMATS
from fisheye_ep_calib.pipeline.exporting import export

SIZE, GRID = (1280, 960), (400.0, 401.0, 642.3, 477.7)
FIELD = np.radians(80)
GENNERY = FisheyeCamera(
    SIZE, *GRID, radial=(0.03, -0.004, 0.0, 0.0), model="gennery", coefficients=(5e-3, -1e-3, 2e-4), theta_max=FIELD
)
EVEN = FisheyeCamera(
    SIZE, *GRID, radial=(0.03, -0.004, 1e-3, -2e-4), model="ep_even", coefficients=(-9e-4, -2.5e-4), theta_max=FIELD
)
CENTRAL = FisheyeCamera(SIZE, *GRID, radial=(0.03, -0.004, 1e-3, -2e-4), theta_max=FIELD)
SIX_TERMS = FisheyeCamera(
    SIZE,
    *GRID,
    radial=(0.03, -0.004, 1e-3, -2e-4, 3e-5, -4e-6),
    lens="kannala_brandt_6",
    extras={"tangential": (8e-4, -5e-4)},
    theta_max=FIELD,
)
MRCAL = """
import json, sys, mrcal
model = mrcal.cameramodel(sys.argv[1])
name, intrinsics = model.intrinsics()
placed = model.rt_cam_ref() if hasattr(model, "rt_cam_ref") else model.extrinsics_rt_fromref()
print(json.dumps([name, intrinsics.tolist(), placed.tolist(), list(map(int, model.imagersize()))]))
"""


@lru_cache
def python_with_mrcal() -> str:
    """This Python, or the system's: Debian has mrcal."""
    for python in (sys.executable, "/usr/bin/python3"):
        known = Path(python).exists() and subprocess.run([python, "-c", "import mrcal"], capture_output=True)
        if known and known.returncode == 0:
            return python
    pytest.skip("mrcal is not installed (python3-mrcal, or mrcal from PyPI)")


def libmrcal() -> ctypes.CDLL:
    """mrcal's library: the one that MRCAL_LIBRARY names, of a wheel from PyPI, or the system's."""
    beside = [str(path) for place in sys.path for path in Path(place or ".").glob("mrcal.libs/libmrcal-*.so*")]
    name = os.environ.get("MRCAL_LIBRARY") or next(iter(beside), None) or ctypes.util.find_library("mrcal")
    if name is None:
        pytest.skip("libmrcal is not installed (mrcal from PyPI; MRCAL_LIBRARY names another)")
    return ctypes.CDLL(name)


def projected_by_mrcal(intrinsics: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of mrcal_project with LENSMODEL_CAHVORE, linearity 0."""
    library, model = libmrcal(), ctypes.create_string_buffer(256)
    library.mrcal_lensmodel_from_name.restype = library.mrcal_project.restype = ctypes.c_bool
    assert library.mrcal_lensmodel_from_name(model, b"LENSMODEL_CAHVORE_linearity=0.00")

    def pointer(array: np.ndarray) -> ctypes.c_void_p:
        return array.ctypes.data_as(ctypes.c_void_p)

    def project(places: np.ndarray) -> np.ndarray:
        places, pixels = np.ascontiguousarray(places), np.zeros((len(places), 2))
        values = np.ascontiguousarray(intrinsics, dtype=float)
        count = ctypes.c_int(len(places))
        assert library.mrcal_project(pointer(pixels), None, None, pointer(places), count, model, pointer(values))
        return pixels

    close = points[:9] / np.linalg.norm(points[:9], axis=-1, keepdims=True)
    if np.any(intrinsics[9:]) and np.abs(project(0.1 * close) - project(close)).max() < 1e-6:
        pytest.skip("this mrcal takes CAHVORE for a camera with one viewpoint, as 2.2 does")
    return project(points)


def cameramodel(path: Path) -> dict:
    return ast.literal_eval(path.read_text())


def test_mrcal_reads_the_file(tmp_path) -> None:
    export(GENNERY, "mrcal", tmp_path / "front.cameramodel")
    command = [python_with_mrcal(), "-c", MRCAL, str(tmp_path / "front.cameramodel")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    name, intrinsics, placed, size = json.loads(done.stdout)
    assert name == "LENSMODEL_CAHVORE_linearity=0.00" and tuple(size) == SIZE and placed == [0.0] * 6
    assert intrinsics == cameramodel(tmp_path / "front.cameramodel")["intrinsics"]


def over_image(camera: FisheyeCamera, distance: float) -> tuple[np.ndarray, np.ndarray]:
    pixels, points = points_over_image(camera, distance)
    return pixels, FAR * points if np.isinf(distance) else points


@pytest.mark.parametrize("distance", [0.1, 0.5, np.inf])
def test_mrcal_sees_gennerys_pupil_as_it_is(distance, tmp_path) -> None:
    export(GENNERY, "mrcal", tmp_path / "front.cameramodel")
    pixels, points = over_image(GENNERY, distance)
    found = projected_by_mrcal(np.array(cameramodel(tmp_path / "front.cameramodel")["intrinsics"]), points)
    assert np.abs(found - pixels).max() < 1e-6


@pytest.mark.parametrize("distance", [0.1, 0.3, 1.0, np.inf])
def test_mrcal_sees_another_pupil_with_the_loss_that_is_stated(distance, tmp_path) -> None:
    export(EVEN, "mrcal", tmp_path / "front.cameramodel")
    (written,) = FORMATS["mrcal"].read((tmp_path / "front.cameramodel").read_text())
    pixels, points = over_image(EVEN, distance)
    projected = projected_by_mrcal(np.array(cameramodel(tmp_path / "front.cameramodel")["intrinsics"]), points)
    found = float(np.sqrt(((projected - pixels) ** 2).sum(axis=-1).mean()))
    assert found == pytest.approx(loss_px(EVEN, written.camera, [distance])[distance], rel=1e-4)
    assert found < 0.02


def colmap_camera(path: Path):
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed (PyPI)")
    for name in ("images.txt", "points3D.txt"):
        (path.parent / name).touch()
    return pycolmap.Reconstruction(str(path.parent)).cameras[1]


@pytest.mark.parametrize("camera", [CENTRAL, SIX_TERMS], ids=["OPENCV_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE"])
def test_colmap_sees_the_same_pixels(camera, tmp_path, request) -> None:
    export(camera, "colmap", tmp_path / "cameras.txt")
    read = colmap_camera(tmp_path / "cameras.txt")
    assert read.model.name in request.node.name and (read.width, read.height) == SIZE
    pixels, points = over_image(camera, np.inf)
    front = points[:, 2] > 0.2 * FAR
    found = np.array(read.img_from_cam(points[front] / points[front, 2:]))
    assert np.abs(found - 0.5 - pixels[front]).max() < 1e-6
