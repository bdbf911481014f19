"""How large a target's smallest feature must be for its points to be found: where guidance draws the line.

Boards at random poses through the paper's camera at half its size, sharp and blurred; each view by the pixels across of
its smallest feature and the share of its points that one look finds.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from fisheye_ep_calib.simulation import paper_camera, paper_target, random_poses
from fisheye_ep_calib.simulation.rendering import Imaging, render
from fisheye_ep_calib.target import parse_target

TARGETS = {
    "circles": paper_target(),
    "chessboard": parse_target({"type": "chessboard", "columns": 10, "rows": 7, "spacing": 0.012}),
    "aprilgrid": parse_target({"type": "aprilgrid", "columns": 4, "rows": 3, "tag_size": 0.03, "tag_gap": 0.009}),
}
EDGES = (0, 3, 4, 5, 5.5, 6, 7, 8, 10, 100)  # pixels across


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, default=50)
    arguments = parser.parse_args()
    camera = paper_camera()
    camera = replace(camera, image_size=(1024, 1024), fx=camera.fx / 2, fy=camera.fy / 2, cx=506.3, cy=512.3)
    for name, target in TARGETS.items():
        poses = random_poses(target, arguments.views, 5, (0.08, 0.6), (0, 92), (0, 60))
        for blur in (0.7, 2.0):
            sizes, shares = [], []
            for number, pose in enumerate(poses):
                points = target.object_points @ pose[:3, :3].T + pose[:3, 3]
                _, _, d_point, _ = replace(camera, theta_max=np.pi).project_with_jacobian(points)
                across = np.linalg.svd(np.nan_to_num(d_point @ pose[:3, :2]), compute_uv=False)[:, 1]
                sizes.append(across.min() * target.smallest_feature)
                imaging = Imaging(blur=blur, noise=2.0 + blur, texture=40.0, vignetting=0.4, seed=number)
                found = target.detector().detect(render(camera, target, pose, imaging))
                shares.append(len(found) / len(points))
            bins = np.digitize(sizes, EDGES)
            for low, high, which in zip(EDGES[:-1], EDGES[1:], range(1, len(EDGES)), strict=True):
                inside = bins == which
                if inside.any():
                    good = np.mean(np.array(shares)[inside] >= 0.8)
                    print(f"{name}, blur {blur}: {low}–{high} px: {good:.2f} of {inside.sum()} found with 80 %")


if __name__ == "__main__":
    main()
