"""How large a target's smallest feature must be for its points to be found, and how much of the board about them must
be seen: where guidance draws the lines.

Boards at random poses through the paper's camera at half its size, sharp and blurred; each view by the pixels across of
its smallest feature and the share of its points that one look finds. Then boards at the edge of a rectangular image, by
how much about their points is inside, in pitches: the root of the board's area for each point.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.simulation import paper_camera, paper_target, random_poses
from fisheye_ep_calib.simulation.rendering import Imaging, render
from fisheye_ep_calib.target import Target, load_target, parse_target

TARGETS = {
    "circles": paper_target(),
    "chessboard": parse_target({"type": "chessboard", "columns": 10, "rows": 7, "spacing": 0.012}),
    "aprilgrid": parse_target({"type": "aprilgrid", "columns": 4, "rows": 3, "tag_size": 0.03, "tag_gap": 0.009}),
    "charuco": load_target("charuco_10x7"),
}
EDGES = (0, 3, 4, 5, 5.5, 6, 7, 8, 10, 100)  # pixels across
MARGINS = (0.0, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0)  # pitches


def seen_margin(camera: FisheyeCamera, target: Target, pose: np.ndarray) -> float:
    """The largest of MARGINS that is inside the image about the points at a pose, −1 where not even the points are."""
    low, high = target.object_points.min(axis=0)[:2], target.object_points.max(axis=0)[:2]
    pitch = np.sqrt(np.prod(high - low) / len(target.object_points))
    best = -1.0
    for margin in MARGINS:
        part = np.linspace(0, 1, 9)[:, None]
        start, end = low - margin * pitch, high + margin * pitch
        across = start + part * (end - start)
        sides = [np.stack([across[:, 0], np.full(9, y)], axis=-1) for y in (start[1], end[1])]
        sides += [np.stack([np.full(9, x), across[:, 1]], axis=-1) for x in (start[0], end[0])]
        edge = np.hstack([np.concatenate(sides), np.zeros((36, 1))])
        pixels, valid = camera.project(edge @ pose[:3, :3].T + pose[:3, 3])
        if not (valid & ((pixels > 0) & (pixels < np.array(camera.image_size) - 1)).all(axis=-1)).all():
            break
        best = margin
    return best


def at_the_edge(name: str, target: Target, views: int) -> None:
    camera = FisheyeCamera((960, 720), 573.0, 573.0, 479.5, 359.5, radial=(0.0, 0.0, 0.0, 0.0), theta_max=np.pi)
    poses = random_poses(target, 100 * views, 11, (0.07, 0.2), (5, 55), (0, 50))
    margins = np.array([seen_margin(camera, target, pose) for pose in poses])
    for margin in MARGINS:
        chosen = np.flatnonzero(margins == margin)[: max(2, views // 5)]
        found = [
            len(
                target.detector().detect(
                    render(camera, target, poses[one], Imaging(blur=0.7, noise=2.0, seed=int(one)))
                )
            )
            for one in chosen
        ]
        if found:
            share = np.array(found) / len(target.object_points)
            all_of_them, most = np.mean(share == 1), np.mean(share >= 0.8)
            text = f"all in {all_of_them:.2f}, 80 % in {most:.2f} of {len(found)}"
            print(f"{name}, {margin} pitches seen about the points: {text}")


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
        at_the_edge(name, target, arguments.views)


if __name__ == "__main__":
    main()
