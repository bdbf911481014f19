"""The pictures of README and docs, computed: python docs/make_images.py

Left: rays of a ray-traced 170° lens before its first surface, and where they would cross the axis. Right: cameras
fitted to one simulated recording of that lens at 100–150 mm, compared with the lens itself at other distances.

The second picture shows places of a board in the image that tell something, and such that do not.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib
import numpy as np

from fisheye_ep_calib import FisheyeCamera, calibrate
from fisheye_ep_calib.camera.directions import direction
from fisheye_ep_calib.simulation import observe, paper_poses, paper_target
from fisheye_ep_calib.simulation.poses import look_pose
from fisheye_ep_calib.simulation.ray_traced_camera import RayTracedCamera, laikin_camera
from fisheye_ep_calib.simulation.rendering import Imaging, render
from fisheye_ep_calib.target.boards.chessboard import Chessboard

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

IMAGES = Path(__file__).parent / "images"
ANGLES = (0, 15, 30, 45, 60, 70, 80, 85)  # degrees
MODELS = {"kannala": ("one viewpoint", "tab:red"), "ep_even": ("moving entrance pupil", "tab:blue")}
RECORDED = (0.10, 0.15)  # metres
DISTANCES = np.geomspace(0.05, 10, 25)  # metres
NOISE = 0.05  # px per axis
PLACES = {  # what is shown: θ, azimuth, distance in metres, tilt, roll; angles in degrees
    "in the middle, tilted": (15, 200, 0.12, 30, 0),
    "at the edge, cut off": (72, 20, 0.11, 10, 30),
    "in a corner, near": (58, 225, 0.08, 15, -30),
    "there at twice that distance": (62, 225, 0.17, 25, -20),
    "far away": (10, 0, 0.5, 0, 0),
    "middle only, parallel to the sensor": (3, 0, 0.14, 0, 0),
    "the same place again": (3, 0, 0.14, 0, 0),
    "moved while exposed": (25, 10, 0.14, 10, 0),
}


def draw_rays(axes: plt.Axes, camera: RayTracedCamera) -> None:
    """Chief rays in the meridional plane, millimetres, origin at the paraxial entrance pupil."""
    vertex, radius = 1e3 * camera.lens.entrance_pupil, 1e3 * camera.lens.radii[0]
    bend = np.linspace(-0.25, 1.0, 200)
    axes.plot(vertex - radius + radius * np.cos(bend), radius * np.sin(bend), color="0.35", lw=2)
    axes.axhline(0, color="0.6", lw=0.8)
    colors = plt.get_cmap("viridis")(np.linspace(0, 0.85, len(ANGLES)))
    for angle, color in zip(ANGLES, colors, strict=True):
        theta = np.radians(angle)
        pupil = np.array([-1e3 * float(camera.entrance_pupil(theta)), 0.0])
        direction = np.array([np.cos(theta), np.sin(theta)])
        # |pupil + t direction − centre| = radius: where the ray meets the first surface.
        offset = pupil - [vertex - radius, 0.0]
        along = -(offset @ direction) + np.sqrt((offset @ direction) ** 2 - offset @ offset + radius**2)
        surface, scene = pupil + along * direction, pupil + (along + 14) * direction
        axes.plot(*np.transpose([pupil, surface]), color=color, lw=1, ls=(0, (3, 2)))
        axes.plot(*np.transpose([surface, scene]), color=color, lw=1.6)
        axes.plot(*pupil, "o", color=color, ms=5)
        axes.annotate(f"{angle}°", scene, textcoords="offset points", xytext=(3, 2), fontsize=8, color=color)
    axes.set(
        title="Each ray aims at its own point of the axis",
        xlabel="along the optical axis, mm (0: entrance pupil of rays near the axis)",
        ylabel="mm",
        xlim=(-6, 50),
        ylim=(-6, 52),
        aspect="equal",
    )
    axes.text(vertex + 0.8, -4, "first surface", fontsize=8, color="0.35")


def draw_errors(axes: plt.Axes, lens: RayTracedCamera) -> None:
    """Pixel error by distance, RMS over the field to 80°, of cameras fitted to one recording."""
    board = Chessboard.create("board", 11, 7, spacing=0.012)
    poses = paper_poses(board)
    observations = observe(lens, board, poses, noise=NOISE)
    for model, (label, color) in MODELS.items():
        result = calibrate(observations, model)
        seen = poses[result.view_images]
        motion = rigid_motion(points_of(seen, board), points_of(result.camera_from_target, board))
        errors = [error_at(distance, lens, result.camera, motion) for distance in DISTANCES]
        axes.loglog(DISTANCES, errors, color=color, lw=2, label=f"{label}: {result.rms_px:.2f} px RMS when calibrated")
    axes.axvspan(*RECORDED, color="0.88", lw=0)
    axes.text(np.sqrt(np.prod(RECORDED)), 0.006, "recorded\nhere", ha="center", fontsize=8, color="0.35")
    axes.set(
        title="Error at other distances",
        xlabel="distance of the scene, m",
        ylabel="px, RMS over the field to 80°",
        ylim=(0.004, 100),
    )
    axes.grid(True, which="major", color="0.9")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
    axes.legend(fontsize=8, loc="upper right")


def points_of(poses: np.ndarray, board: Chessboard) -> np.ndarray:
    """The board's points in the camera frame, (V·n, 3), metres."""
    return (board.object_points @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3]).reshape(-1, 3)


def rigid_motion(source: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R (3, 3) and t (3,) with goal ≈ R source + t: a calibration chooses its frame freely (Kabsch, 1976)."""
    middle, end = source.mean(axis=0), goal.mean(axis=0)
    left, _, right = np.linalg.svd((goal - end).T @ (source - middle))
    rotation = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    return rotation, end - rotation @ middle


def error_at(distance: float, lens: RayTracedCamera, camera: FisheyeCamera, motion) -> float:
    """RMS pixel difference of lens and camera for points at a distance, over the field to 80°."""
    theta, azimuth = np.meshgrid(np.radians(np.arange(2, 81, 2)), np.radians(np.arange(0, 360, 15)))
    points = distance * direction(theta, azimuth)
    rotation, translation = motion
    true, seen = lens.project(points)
    pixels, valid = camera.project(points @ rotation.T + translation)
    square = ((pixels - true) ** 2).sum(axis=-1)[seen & valid]
    return float(np.sqrt(square.mean()))


def draw_places() -> plt.Figure:
    """A board held where it tells something (above), and where it does not (below)."""
    camera, board = laikin_camera(), paper_target()
    figure, rows = plt.subplots(2, 4, figsize=(11, 5.9), layout="constrained")
    for number, (axes, (name, place)) in enumerate(zip(rows.flat, PLACES.items(), strict=True)):
        theta, azimuth, distance, tilt, roll = place
        angles = np.radians([theta, azimuth, tilt, roll])
        pose = look_pose(board, angles[0], angles[1], distance, angles[2], 0.7, angles[3])
        image = render(camera, board, pose, Imaging(texture=12, vignetting=0.3))
        if name.startswith("moved"):
            image = cv2.blur(image, (41, 3))
        axes.imshow(image, cmap="gray", vmin=0, vmax=255)
        good = number < rows.shape[1]
        axes.set_title(f"{'✓' if good else '✗'} {name}", fontsize=10, color="tab:green" if good else "tab:red")
        axes.set(xticks=[], yticks=[])
    return figure


def main() -> None:
    lens = laikin_camera()
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), width_ratios=(1, 1), layout="constrained")
    draw_rays(left, lens)
    draw_errors(right, lens)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    IMAGES.mkdir(exist_ok=True)
    figure.savefig(IMAGES / "entrance_pupil.png", dpi=110)
    draw_places().savefig(IMAGES / "places.png", dpi=80)
    print(f"wrote {IMAGES}")


if __name__ == "__main__":
    main()
