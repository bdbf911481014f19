"""What reading and detecting cost against another version of this package, as ratios of processor time.

    git worktree add /tmp/before COMMIT
    PYTHONPATH=test/support python benchmarks/reading_cost.py --against /tmp/before [--only ros1] [--rounds 60]

Small recordings of every format, where what is checked weighs most beside what is decoded, and each kind of board. One
process for each version, both running all the time; they are asked by turns for the same work of some hundredths of a
second, so that a busy machine slows both alike. Told are the median of the ratios, and milliseconds an image.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from bag_writers import COMPRESSED_IMAGE, images, messages, write_db3, write_folder, write_mcap, write_ros1

from fisheye_ep_calib.simulation import Imaging, look_pose, paper_camera
from fisheye_ep_calib.simulation.rendering import render
from fisheye_ep_calib.target import load_target

HERE = Path(__file__).resolve().parents[1]
LIMIT = 1.05
SLICE = 0.03  # seconds of work between two turns
BOARDS = ("circle_grid_11x7", "chessboard_9x6", "charuco_10x7", "aprilgrid_6x5")
WORKER = """
import sys, time
from pathlib import Path
import cv2
import fisheye_ep_calib
from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.target import load_target
cv2.setNumThreads(1)
print(Path(fisheye_ep_calib.__file__).resolve().parents[1], flush=True)
work = {}

def reading(path):
    recording = open_recording(path)
    (topic,) = [topic.name for topic in recording.image_topics()]
    count = recording.count(topic)
    def read():
        for index in range(count):
            recording.frame(topic, index).image()
        return count
    return read

def opening(path):
    def open_it():
        open_recording(path).close()
        return 1
    return open_it

def detecting(path, board):
    detector = load_target(board).detector()
    image = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    def look():
        detector.detect(image)
        return 1
    return look

for line in sys.stdin:
    name, times, kind, *rest = line.rstrip("\\n").split("\\t")
    if name not in work:
        work[name] = {"read": reading, "open": opening, "detect": detecting}[kind](*rest)
        work[name]()
    began = time.process_time()
    done = sum(work[name]() for _ in range(int(times)))
    print((time.process_time() - began) / done, flush=True)
"""


class Version:
    """A process that has this version of the package."""

    def __init__(self, package: Path) -> None:
        environment = os.environ | {"PYTHONPATH": str(package), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-c", WORKER]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment, cwd=package
        )
        assert self._process.stdout is not None
        if Path(self._process.stdout.readline().strip()) != package.resolve():
            raise SystemExit(f"{package} is not what is imported")

    def seconds(self, name: str, times: int, work: list[str]) -> float:
        """Processor time an image."""
        assert self._process.stdin is not None and self._process.stdout is not None
        print(name, times, *work, sep="\t", file=self._process.stdin, flush=True)
        return float(self._process.stdout.readline())

    def close(self) -> None:
        self._process.communicate()


def recordings(folder: Path) -> dict[str, Path]:
    """A file or folder of each format, by what it is called in the table."""
    small, large = images(12, 160, 160), [smooth(image) for image in images(12, 640, 480)]
    return {
        "MCAP, raw": write_mcap(folder / "raw.mcap", messages(small)),
        "MCAP of 640×480, PNG": write_mcap(folder / "png.mcap", messages(large, kind=COMPRESSED_IMAGE)),
        "db3, raw": write_db3(folder / "raw.db3", messages(small)),
        "db3 of 640×480, raw": write_db3(folder / "large.db3", messages(large)),
        "ROS 1, raw": write_ros1(folder / "raw.bag", messages(small)),
        "ROS 1 of 640×480, raw": write_ros1(folder / "large.bag", messages(large), chunk_bytes=768 * 1024),
        "ROS 1, PNG": write_ros1(folder / "png.bag", messages(small, kind=COMPRESSED_IMAGE)),
        "ROS 1, lz4": write_ros1(folder / "lz4.bag", messages(small), compression="lz4"),
        **{f"{suffix[1:].upper()} files": write_folder(folder / suffix[1:], small, suffix)
           for suffix in (".png", ".jpg", ".pgm", ".tif", ".bmp")},
        **{f"{suffix[1:].upper()} files of 640×480": write_folder(folder / f"large_{suffix[1:]}", large, suffix)
           for suffix in (".png", ".jpg", ".pgm")},
    }  # fmt: skip


def smooth(image: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), 3)


def boards(folder: Path) -> dict[str, list[str]]:
    """An image of each board, and the board."""
    camera, shown = paper_camera(), {}
    for name in BOARDS:
        target = load_target(name)
        pose = look_pose(target, np.radians(30), 0.4, 0.15, np.radians(20))
        path = folder / f"{name}.png"
        cv2.imwrite(str(path), render(camera, target, pose, Imaging(blur=0.7, noise=2.0)))
        shown[name] = [str(path), name]
    return shown


def compared(versions: list[Version], name: str, work: list[str], rounds: int) -> float:
    """Prints a line; returns the median of this version's processor time over the other's."""
    once = max(version.seconds(name, 3, work) for version in versions)
    times = max(1, min(1000, int(SLICE / max(once, 1e-6) / (12 if work[0] == "read" else 1))))
    pairs = []
    for turn in range(rounds):
        order = versions if turn % 2 else versions[::-1]
        took = {version: version.seconds(name, times, work) for version in order}
        pairs.append([took[version] for version in versions])
    ratio = statistics.median(here / there for here, there in pairs)
    here, there = (1e3 * statistics.median(column) for column in zip(*pairs, strict=True))
    print(f"| {name} | {there:.3f} | {here:.3f} | {ratio:.3f}{' !' if ratio > LIMIT else ''} |", flush=True)
    return ratio


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, required=True, help="a folder with the other version")
    parser.add_argument("--only", default="", help="what has this in its name")
    parser.add_argument("--rounds", type=int, default=60)
    arguments = parser.parse_args()
    versions = [Version(HERE), Version(arguments.against)]
    ratios = []
    print("| | before, ms | now, ms | ratio |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        kinds: dict[str, Callable[[Path], dict[str, list[str]]]] = {
            "reading": lambda path: {name: ["read", str(file)] for name, file in recordings(path).items()},
            "opening": lambda path: {name: ["open", str(file)] for name, file in recordings(path).items()},
            "detecting": lambda path: {name: ["detect", *rest] for name, rest in boards(path).items()},
        }
        for kind, made in kinds.items():
            place = Path(folder) / kind
            place.mkdir()
            for name, work in made(place).items():
                if arguments.only in f"{kind} {name}":
                    ratios.append(compared(versions, f"{kind} {name}", work, arguments.rounds))
    for version in versions:
        version.close()
    print(f"at most {max(ratios):.3f} ×, limit {LIMIT}")
    return int(max(ratios) > LIMIT)


if __name__ == "__main__":
    sys.exit(main())
