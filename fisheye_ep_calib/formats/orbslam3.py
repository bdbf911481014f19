"""ORB-SLAM3's settings, File.version 1.0, read by cv::FileStorage: KannalaBrandt8, one camera or two.

Stereo.T_c1_c2 is the first camera from the second. Numbers that its reader wants real must not look whole.
(ORB_SLAM3, src/Settings.cc; Examples/Stereo/TUM-VI.yaml.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.placed_camera import PlacedCamera, statement

_OTHER = """
# not of the calibration: the settings of ORB-SLAM3's own example, to be chosen for the sequence
Camera.fps: 20
Camera.RGB: 1
ORBextractor.nFeatures: 1500
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7
Viewer.KeyFrameSize: 0.05
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 0.9
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.08
Viewer.CameraLineWidth: 3.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -0.7
Viewer.ViewpointZ: -3.5
Viewer.ViewpointF: 500.0
"""


def write(cameras: Sequence[PlacedCamera], _named: Named) -> Written:
    """Kannala–Brandt cameras with one viewpoint."""
    central = [placed.central().camera for placed in cameras]
    words = statement(cameras, central)
    width, height = central[0].image_size
    lines = ["%YAML:1.0", *(f"# {line}" for line in words), 'File.version: "1.0"', 'Camera.type: "KannalaBrandt8"']
    for number, camera in enumerate(central, start=1):
        lines += _camera_lines(number, camera)
        if len(cameras) > 1:
            lines.append(f"Camera{number}.overlappingBegin: 0")
            lines.append(f"Camera{number}.overlappingEnd: {camera.image_size[0] - 1}")
    lines += [f"Camera.width: {width}", f"Camera.height: {height}"]
    if len(cameras) > 1:
        lines += _matrix_lines("Stereo.T_c1_c2", cameras[0].camera_from_reference @ cameras[1].reference_from_camera)
        lines.append("Stereo.ThDepth: 40.0")
        if central[0].image_size != central[1].image_size:
            words = (*words, "ORB-SLAM3 takes both images for the size of the first: these differ")
    return Written({"": "\n".join(lines) + _OTHER}, words)


def _camera_lines(number: int, camera: FisheyeCamera) -> list[str]:
    values = {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy}
    values |= {f"k{term}": value for term, value in enumerate(camera.radial, start=1)}
    return [f"Camera{number}.{name}: {real(value)}" for name, value in values.items()]


def _matrix_lines(name: str, matrix: np.ndarray) -> list[str]:
    """With single precision, as its reader wants it."""
    data = ", ".join(real(value) for value in matrix.ravel())
    head = f"{name}: !!opencv-matrix"
    return [head, f"   rows: {matrix.shape[0]}", f"   cols: {matrix.shape[1]}", "   dt: f", f"   data: [{data}]"]


def real(value: float) -> str:
    """All digits of a number, with a point or an exponent that says it is real."""
    return repr(float(value))


ORBSLAM3 = Format("orbslam3", "ORB-SLAM3's settings (KannalaBrandt8)", write, most_cameras=2)
