"""What is given twice counts once: images that count double promise more than they tell."""

import shutil

import pytest
from bag_writers import images, messages, write_folder, write_mcap, write_rosbag2

from fisheye_ep_calib.storage.recording import open_recording

PICTURES = images()
RECORDED = messages(PICTURES)


def twice(path):
    """A bag, and what holds the same images under another name."""
    bag = write_mcap(path / "a.mcap", RECORDED)
    shutil.copy(bag, path / "copy.mcap")
    (path / "link.mcap").symlink_to(bag)
    return bag


@pytest.mark.parametrize("names, said", [(["copy.mcap"], "are those of"), (["link.mcap"], ""), (["a.mcap"], "")])
def test_an_image_that_is_given_twice_counts_once(tmp_path, names, said):
    bag = twice(tmp_path)
    with open_recording([bag, *(tmp_path / name for name in names)]) as recording:
        assert recording.count("/camera/image_raw") == len(PICTURES)
        assert [said in problem for problem in recording.problems] == [True] * bool(said)


def test_images_of_equal_time_are_not_taken_for_copies(tmp_path):
    write_mcap(tmp_path / "a.mcap", RECORDED)
    write_mcap(tmp_path / "b.mcap", messages(images(seed=1)))
    with open_recording([tmp_path / "a.mcap", tmp_path / "b.mcap"], strict=True) as recording:
        assert recording.count("/camera/image_raw") == 2 * len(PICTURES)


def test_a_folder_and_a_pattern_for_the_same_images(tmp_path):
    folder = write_folder(tmp_path / "front", PICTURES)
    with open_recording([folder, str(folder / "*.png")], strict=True) as recording:
        assert [topic.count for topic in recording.image_topics()] == [len(PICTURES)]


def test_what_a_player_unpacked_is_not_read_twice_and_a_strange_file_is_told(tmp_path):
    bag = write_rosbag2(tmp_path / "bag", RECORDED, compression="file")
    (packed,) = bag.glob("*.zstd")
    (plain,) = write_rosbag2(tmp_path / "plain", RECORDED).glob("*.db3")
    shutil.copy(plain, packed.with_suffix(""))
    with open_recording(bag, strict=True) as recording:
        assert recording.count("/camera/image_raw") == len(PICTURES)
    write_mcap(bag / "other.mcap", messages(images(seed=1), "/other"))
    with open_recording(bag) as recording:
        assert "other.mcap not listed in metadata.yaml" in recording.problems[0]
