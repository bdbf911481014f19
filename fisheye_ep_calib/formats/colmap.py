"""COLMAP's cameras.txt, and of a rig its rig_config.json.

COLMAP's (0, 0) is the corner of the top-left pixel, not its centre: half a pixel is added to cx and cy.
cam_from_rig is a camera from the rig, quaternions are (w, x, y, z).
OPENCV_FISHEYE has k1..k4. RAD_TAN_THIN_PRISM_FISHEYE has six radial terms and the decentering of the fisheye's own
plane, p0 and p1 of it p2 and p1 here: cameras with these go out as they are.
(COLMAP, doc/cameras.rst, doc/rigs.rst, src/colmap/sensor/models.h.)
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.placed_camera import (
    KANNALA_BRANDT,
    PlacedCamera,
    floats,
    rotation_quaternion,
    statement,
)

CORNER = 0.5  # px, from the centre of the top-left pixel to its corner


def write(cameras: Sequence[PlacedCamera], _named: Named) -> Written:
    """Cameras with one viewpoint, with as many terms as COLMAP has for them."""
    central = [placed.central((KANNALA_BRANDT, "kannala_brandt_6"), ("tangential",)).camera for placed in cameras]
    words = statement(cameras, central)
    lines = [f"# {line}" for line in (*words, "CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]")]
    for number, camera in enumerate(central, start=1):
        model, values = parameters(camera)
        lines.append(" ".join(map(repr, [number, *camera.image_size, *values])).replace(" ", f" {model} ", 1))
    files = {"": "\n".join(lines) + "\n"}
    if len(cameras) > 1:
        rig = [_in_rig(placed, camera) for placed, camera in zip(cameras, central, strict=True)]
        files["_rig_config.json"] = json.dumps([{"cameras": rig}], indent=2) + "\n"
    return Written(files, words)


def parameters(camera: FisheyeCamera) -> tuple[str, list[float]]:
    """Name and parameters of COLMAP's model."""
    grid = [camera.fx, camera.fy, camera.cx + CORNER, camera.cy + CORNER]
    if camera.lens == KANNALA_BRANDT and not camera.extras:
        return "OPENCV_FISHEYE", floats([*grid, *camera.radial])
    radial = [*camera.radial, 0.0, 0.0][:6]
    p1, p2 = camera.extras.get("tangential", (0.0, 0.0))
    return "RAD_TAN_THIN_PRISM_FISHEYE", floats([*grid, *radial, p2, p1, 0.0, 0.0, 0.0, 0.0])


def _in_rig(placed: PlacedCamera, camera: FisheyeCamera) -> dict[str, Any]:
    model, values = parameters(camera)
    own = {"image_prefix": f"{placed.name}/", "camera_model_name": model, "camera_params": values}
    pose = placed.camera_from_reference
    if (pose == placed.reference_from_camera).all():
        return {**own, "ref_sensor": True}
    x, y, z, w = rotation_quaternion(pose)
    return {**own, "cam_from_rig_rotation": [w, x, y, z], "cam_from_rig_translation": floats(pose[:3, 3])}


COLMAP = Format("colmap", "COLMAP's cameras.txt, of a rig its rig_config.json too", write)
