"""calibrate gives the same camera whatever the recording is stored in."""

from __future__ import annotations

import json
import shutil

from bag_writers import messages, write_folder, write_mcap, write_ros1, write_rosbag2
from mcap.writer import CompressionType

from fisheye_ep_calib.storage.camera_file import load_camera
from fisheye_ep_calib.storage.recording import open_recording


def split_in_two(path, recorded):
    """A rosbag2 folder of two SQLite files."""
    middle = len(recorded) // 2
    parts = [
        write_rosbag2(path.parent / f"part{i}", part) for i, part in enumerate((recorded[:middle], recorded[middle:]))
    ]
    path.mkdir()
    for number, part in enumerate(parts):
        (file,) = part.glob("*.db3")
        shutil.move(file, path / f"whole_{number}.db3")
    listed = "[whole_0.db3, whole_1.db3]"
    (path / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  relative_file_paths: {listed}\n")
    return path


def test_the_same_camera_from_every_format(command, recording, tmp_path) -> None:
    with open_recording(recording / "rig.mcap") as opened:
        pictures = [frame.image() for frame in opened.frames(["/left/image_raw"])]
    recorded = messages(pictures, "/camera/image_raw")
    sources = {
        "sqlite3": write_rosbag2(tmp_path / "sqlite3", recorded),
        "mcap": write_mcap(tmp_path / "plain.mcap", recorded),
        "zstd": write_mcap(tmp_path / "zstd.mcap", recorded, compression=CompressionType.ZSTD),
        "split": split_in_two(tmp_path / "split", recorded),
        "ros1": write_ros1(tmp_path / "ros1.bag", recorded),
        "pictures": write_folder(tmp_path / "pictures", pictures),
    }
    words = ("--target", recording / "board.yaml", "--model", "ep_even", "--workers", 1, "--no-report", "--json")
    found = {}
    for name, source in sources.items():
        ended = command("calibrate", source, *words, "--output", tmp_path / "out" / name)
        assert ended.code == 0, ended.err
        (camera,) = json.loads(ended.out)["cameras"].values()
        found[name] = load_camera(tmp_path / "out" / name / camera["yaml"].rsplit("/")[-1]), camera["points"]
    for name, (camera, points) in found.items():
        assert (camera, points) == found["sqlite3"], name
