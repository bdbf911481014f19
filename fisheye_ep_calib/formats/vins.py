"""VINS-Mono's and VINS-Fusion's camera files (camodocal, KANNALA_BRANDT); of two cameras their configuration too.

camodocal's k2..k5 are k1..k4 here, mu and mv the focal lengths. body_T_cam is the body from the camera: the body is the
reference camera. (camodocal, EquidistantCamera.cc; VINS-Fusion, config/euroc/euroc_stereo_config.yaml.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.orbslam3 import real
from fisheye_ep_calib.formats.placed_camera import PlacedCamera, statement

_OTHER = """
# not of the calibration: the settings of VINS-Fusion's own example, to be chosen for the sequence
output_path: "~/output/"
estimate_extrinsic: 0
multiple_thread: 1
max_cnt: 150
min_dist: 30
freq: 10
F_threshold: 1.0
show_track: 1
flow_back: 1
max_solver_time: 0.04
max_num_iterations: 8
keyframe_parallax: 10.0
estimate_td: 0
td: 0.0
load_previous_pose_graph: 0
pose_graph_save_path: "~/output/pose_graph/"
save_image: 1
"""


def write(cameras: Sequence[PlacedCamera], named: Named) -> Written:
    """One camera: its file. Two: the configuration, which names the cameras' files beside it."""
    central = [placed.central().camera for placed in cameras]
    words = statement(cameras, central)
    if len(cameras) == 1:
        return Written({"": _camera_text(cameras[0].name, central[0], words)}, words)
    files = {
        f"_{placed.name}": _camera_text(placed.name, camera, ())
        for placed, camera in zip(cameras, central, strict=True)
    }
    return Written({"": _configuration(cameras, central, words, named), **files}, words)


def _camera_text(name: str, camera: FisheyeCamera, words: tuple[str, ...]) -> str:
    values = dict(zip(("k2", "k3", "k4", "k5"), camera.radial, strict=True))
    values |= {"mu": camera.fx, "mv": camera.fy, "u0": camera.cx, "v0": camera.cy}
    lines = ["%YAML:1.0", *(f"# {line}" for line in words), "---", "model_type: KANNALA_BRANDT", f"camera_name: {name}"]
    lines += [f"image_width: {camera.image_size[0]}", f"image_height: {camera.image_size[1]}"]
    lines += ["projection_parameters:", *(f"   {key}: {real(value)}" for key, value in values.items())]
    return "\n".join(lines) + "\n"


def _configuration(
    cameras: Sequence[PlacedCamera], central: Sequence[FisheyeCamera], words: tuple[str, ...], named: Named
) -> str:
    width, height = central[0].image_size
    lines = ["%YAML:1.0", *(f"# {line}" for line in words), "imu: 0", f"num_of_cam: {len(cameras)}"]
    for number, placed in enumerate(cameras):
        lines.append(f'image{number}_topic: "{placed.image_topic}"')
        lines.append(f'cam{number}_calib: "{named(f"_{placed.name}")}"')
        lines += [f"body_T_cam{number}: !!opencv-matrix", "   rows: 4", "   cols: 4", "   dt: d"]
        lines.append(f"   data: [{_row(placed.reference_from_camera)}]")
    lines += [f"image_width: {width}", f"image_height: {height}"]
    return "\n".join(lines) + _OTHER


def _row(matrix: np.ndarray) -> str:
    return ", ".join(real(value) for value in matrix.ravel())


VINS = Format("vins", "VINS-Fusion's camera file (camodocal), of a pair its configuration too", write, most_cameras=2)
