"""Writes the seeds: a small, sound input of every format. They are committed; run this again where a format changes:

PYTHONPATH=test/support .venv/bin/python test/fuzz/make_seeds.py
"""

from __future__ import annotations

import shutil
import tarfile
from pathlib import Path

import cv2
import numpy as np
import yaml
from bag_writers import COMPRESSED_IMAGE, messages, write_db3, write_mcap, write_ros1
from judging import SEEDS, SHEET
from known_scenes import CAMERA, seen_board

from fisheye_ep_calib import cli
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.simulation.rendering import Imaging, render
from fisheye_ep_calib.storage.observation_file import save_observations
from fisheye_ep_calib.storage.rig_file import places_yaml
from fisheye_ep_calib.target import load_target

HERE = Path(__file__).resolve().parent
BOARD = "type: chessboard\nname: board\ncolumns: 9\nrows: 6\nspacing: 0.02\n"
SMALL = FisheyeCamera((320, 240), 90, 90, 160, 120, model="ep_even", coefficients=(-0.001, 0.0))
MIDDLE = FisheyeCamera((640, 480), 200, 200, 320, 240)
FOREIGN = {
    "camera_info": "camera_info.yaml",
    "kalibr": "kalibr.yaml",
    "opencv": "opencv.yaml",
    "mrcal": "mrcal.cameramodel",
}
TARGETS = ("circle_grid_11x7_holed", "charuco_10x7", "aprilgrid_6x5")


def pictures(count: int) -> list[np.ndarray]:
    target = load_target(SEEDS / "board.yaml")
    middle = target.object_points.mean(axis=0)
    places = [(0.0, 0.0, 0.12), (0.3, 0.2, 0.14), (-0.3, 0.1, 0.13), (0.1, -0.3, 0.15)]
    views = []
    for number, (right, down, away) in enumerate(places[:count]):
        pose = np.eye(4)
        pose[:3, :3], _ = cv2.Rodrigues(np.array([down, right, 0.1 * number]))
        pose[:3, 3] = -pose[:3, :3] @ middle + [0.02 * number, 0.0, away]
        views.append(render(SMALL, target, pose, Imaging(blur=0.7)))
    return views


def picture_of(name: str) -> np.ndarray:
    """A target's face, whichever way its z axis points, from as far as it is wide."""
    target = load_target(SEEDS / f"target_{name}.yaml")
    points = target.object_points
    away = 0.6 * float(np.ptp(points, axis=0).max())
    views = []
    for turn in (0.0, np.pi):
        pose = np.eye(4)
        pose[:3, :3], _ = cv2.Rodrigues(np.array([turn + 0.1, 0.2, 0.0]))
        pose[:3, 3] = -pose[:3, :3] @ points.mean(axis=0) + [0.0, 0.0, away]
        views.append(render(MIDDLE, target, pose, Imaging(blur=0.7)))
    return max(views, key=lambda view: float(view.std()))


def main() -> None:
    shutil.rmtree(SEEDS, ignore_errors=True)
    SEEDS.mkdir()
    (SEEDS / "board.yaml").write_text(BOARD)
    for name in TARGETS:
        shutil.copy(HERE.parents[1] / "config" / "targets" / f"{name}.yaml", SEEDS / f"target_{name}.yaml")
    save_observations(SEEDS / "observations.npz", seen_board(CAMERA, views=6))
    cli.main(["calibrate", str(SEEDS / "observations.npz"), "--no-report", "--output", str(SEEDS / "out")])
    camera = (SEEDS / "out" / "observations.yaml").read_text("utf-8")
    (SEEDS / "camera.yaml").write_text(camera.replace(f"{SEEDS}/", ""), "utf-8")
    shutil.rmtree(SEEDS / "out")
    for name, file in FOREIGN.items():
        to = str(SEEDS / f"camera_in_{file}")
        cli.main(["export", str(SEEDS / "camera.yaml"), "--to", name, "--output", to])
    rig = yaml.safe_load(places_yaml({"a": np.eye(4), "b": np.eye(4)}))
    for block in rig["cameras"].values():
        block["camera_file"] = "camera.yaml"
    (SEEDS / "rig.yaml").write_text(yaml.safe_dump(rig, sort_keys=False, default_flow_style=None))
    shown = pictures(4)
    write_mcap(SEEDS / "raw.mcap", messages(shown[:2]))
    write_mcap(SEEDS / "compressed.mcap", messages(shown, kind=COMPRESSED_IMAGE))
    write_db3(SEEDS / "compressed.db3", messages(shown[:2], kind=COMPRESSED_IMAGE))
    write_ros1(SEEDS / "compressed.bag", messages(shown[:2], kind=COMPRESSED_IMAGE), compression="bz2")
    for name in TARGETS:
        (SEEDS / f"board_of_{name}.png").write_bytes(cv2.imencode(".png", picture_of(name))[1].tobytes())
    formats = {suffix: [] for suffix in ("png", "tif", "webp", "bmp", "pgm")} | {
        "jpg": [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]
    }
    for suffix, options in formats.items():
        small = shown[0] if suffix in ("png", "jpg", "webp") else shown[0][80:160, 100:220]
        (SEEDS / f"image.{suffix}").write_bytes(cv2.imencode(f".{suffix}", small, options)[1].tobytes())
    with tarfile.open(SEEDS / "images.tar.gz", "w:gz") as archive:
        for number in range(2):
            path = SEEDS / f"left-{number:04d}.png"
            path.write_bytes(cv2.imencode(".png", shown[number])[1].tobytes())
            archive.add(path, path.name)
            path.unlink()
    (SEEDS / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  relative_file_paths: [raw.mcap]\n"
    )
    shutil.rmtree(SEEDS / "compressed.folder", ignore_errors=True)
    SHEET.parent.mkdir()
    cv2.imwrite(str(SHEET), np.full((1200, 1600), 200, np.uint8))
    (SEEDS / "devices.txt").write_text("# a device a line\nobservations.npz\n")


if __name__ == "__main__":
    main()
