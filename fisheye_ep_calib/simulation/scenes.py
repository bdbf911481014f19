"""Known cameras, targets and sets of poses."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.boards.circle_grid import CircleGrid

PAPER_THETA_MAX = float(np.radians(97.5))


def paper_camera(index: int = 0) -> FisheyeCamera:
    """The proposed method's camera of Table 1 of "Calibration of fisheye camera using entrance pupil".

    The pupil's coefficients are read as millimetres; the 195° field of view sets theta_max. The paper's
    device has eight such cameras: index 1, 2, … gives siblings that differ a little in focal length and
    centre.
    """
    rng = np.random.default_rng(index)
    focal, center = rng.normal(0, 1.0, 2).tolist(), rng.normal(0, 4.0, 2).tolist()
    if index == 0:
        focal, center = [0.0, 0.0], [0.0, 0.0]
    return FisheyeCamera(
        image_size=(2048, 2048),
        fx=591.7301 + focal[0],
        fy=592.0340 + focal[1],
        skew=0.1978,
        cx=1013.2001 + center[0],
        cy=1025.0300 + center[1],
        radial=(0.0109, -0.0013, 0.0008, -0.0004),
        model="ep_odd",
        coefficients=(0.0851e-3, -0.2577e-3, 0.3016e-3, 0.5368e-3),
        theta_max=PAPER_THETA_MAX,
    )


def paper_target() -> CircleGrid:
    """The paper's 11 × 7 circle target; pitch and radius, which it does not state, are 12 mm and 4 mm."""
    return CircleGrid.create("circles_11x7", 11, 7, spacing=0.012, radius=0.004)
