"""What to record: how well E(60°) and far pixels are known after different recordings of one simulated lens.

    OMP_NUM_THREADS=1 python benchmarks/recording_advice.py

The lens is the ray-traced 170° one, the board has 11 × 7 corners, 12 mm apart, the noise is 0.1 px per axis.
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib import calibrate
from fisheye_ep_calib.calibration.assessing.uncertainty import projection_uncertainty
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.simulation import observe, random_poses
from fisheye_ep_calib.simulation.ray_traced_camera import laikin_camera
from fisheye_ep_calib.target.boards.chessboard import Chessboard

NOISE = 0.1
NEAR, FAR = (0.10, 0.15), (0.30, 0.45)
THETA = np.radians(60.0)


def main() -> None:
    board = Chessboard.create("board", 11, 7, spacing=0.012)
    recordings = {
        "10 views at 0.10–0.15 m": random_poses(board, 10, 1, NEAR),
        "25 views at 0.10–0.15 m": random_poses(board, 25, 1, NEAR),
        "100 views at 0.10–0.15 m": random_poses(board, 100, 1, NEAR),
        "25 views at 0.10–0.15 m, none tilted": random_poses(board, 25, 1, NEAR, tilt_deg=(0, 3)),
        "25 views at 0.10–0.15 m, within 40°": random_poses(board, 25, 1, NEAR, theta_deg=(0, 40)),
        "25 views at 0.30–0.45 m": random_poses(board, 25, 1, FAR),
    }
    lens = laikin_camera()
    print(f"E(60°) of the lens: {1e3 * lens.entrance_pupil(THETA):.3f} mm")
    print(f"{'recording':<40}{'E(60°) mm':>18}{'px at 0.1 m':>13}{'px at 10 m':>12}   (1σ, at 60°)")
    direction = np.array([np.sin(THETA), 0, np.cos(THETA)])
    for name, poses in recordings.items():
        result = calibrate(observe(lens, board, poses, noise=NOISE))
        camera, known = result.camera, result.uncertainty
        shift = 1e3 * camera.entrance_pupil(THETA)
        sigma = 1e3 * pupil_sigma(camera, known.covariance, THETA)
        near, far = projection_uncertainty(
            camera, known, result.fit.problem.free, np.array([0.1 * direction, 10 * direction])
        )
        print(f"{name:<40}{shift:>9.3f} ± {sigma:.3f}{near:>13.3f}{far:>12.3f}   {result.model}")


if __name__ == "__main__":
    main()
