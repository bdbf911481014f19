"""An interrupted run goes on where it stopped, and ends with what an uninterrupted one gives."""

import os

import pytest
from bag_writers import messages, write_folder, write_mcap
from numbered_target import ABSENT, INTERRUPTS, TARGET, picture

from fisheye_ep_calib.collection import Collector, FrameChoice
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.target.base import rectangular_grid

PICTURES = [picture(x=i) if i % 3 else picture(ABSENT) for i in range(12)]


def collect(folder, target=TARGET, **options):
    with open_recording(folder) as recording, Collector(recording, target, **options) as collector:
        return collector.collect(["front"], FrameChoice(every=1))["front"]


def unreadable_but_alike(path):
    """What must not be read again."""
    found = path.stat()
    path.write_bytes(bytes(found.st_size))
    os.utime(path, ns=(found.st_atime_ns, found.st_mtime_ns))


def test_a_resumed_run_looks_only_at_what_is_left_and_gives_the_same(tmp_path):
    folder = write_folder(tmp_path / "front", PICTURES)
    whole = collect(folder)
    (folder / "frame7.png").rename(tmp_path / "aside.png")
    write_folder(tmp_path / "other", [picture(INTERRUPTS)])
    (tmp_path / "other" / "frame0.png").rename(folder / "frame7.png")
    log = tmp_path / "out" / "detections.jsonl"
    stopped = collect(folder, log=log)
    assert stopped.interrupted and len(stopped.frames) == 7

    (tmp_path / "aside.png").replace(folder / "frame7.png")
    for number in range(7):
        unreadable_but_alike(folder / f"frame{number}.png")
    resumed = collect(folder, log=log, resume=True)
    assert not resumed.interrupted and resumed.unused == whole.unused
    one, other = (run.observations(TARGET.object_points) for run in (resumed, whole))
    assert one.pixels.tobytes() == other.pixels.tobytes() and one.image_names == other.image_names


def test_a_log_cut_by_a_crash_is_used_up_to_there(tmp_path):
    folder = write_folder(tmp_path / "front", PICTURES)
    log = tmp_path / "detections.jsonl"
    whole = collect(folder, log=log)
    content = log.read_bytes()
    for length in range(len(content.split(b"\n")[0]) + 1, len(content), 397):
        log.write_bytes(content[:length])
        resumed = collect(folder, log=log, resume=True)
        assert resumed.unused == whole.unused and [v.name for v in resumed.views] == [v.name for v in whole.views]
        assert log.read_bytes().count(b"\n") == 13


def test_a_log_of_something_else_is_refused(tmp_path):
    folder = write_folder(tmp_path / "front", PICTURES)
    log = tmp_path / "detections.jsonl"
    collect(folder, log=log)
    for other in (
        type(TARGET)("other", rectangular_grid(4, 3, 2.0, 1.0), None),
        type(TARGET)("other", TARGET.object_points, 0.1),
    ):
        with pytest.raises(InputError, match="another recording or target; run without `resume`"):
            collect(folder, target=other, log=log, resume=True)
    assert collect(folder, target=type(TARGET)("same", TARGET.object_points, None), log=log, resume=True)
    (folder / "frame3.png").unlink()
    with pytest.raises(InputError, match="another recording"):
        collect(folder, log=log, resume=True)
    log.write_text("not a log\n")
    with pytest.raises(InputError, match="damaged"):
        collect(folder, log=log, resume=True)
    assert len(collect(folder, log=log).frames) == 11
    with pytest.raises(CalibrationError, match="cannot be used"):
        collect(folder, log=tmp_path)


def test_the_log_is_removed_once_it_is_not_needed(tmp_path):
    folder = write_folder(tmp_path / "front", PICTURES)
    log = tmp_path / "detections.jsonl"
    with open_recording(folder) as recording, Collector(recording, TARGET, log=log) as collector:
        collector.collect(["front"])
        assert log.exists()
        collector.forget()
    assert not log.exists()


def test_what_could_not_be_read_is_looked_at_again(tmp_path):
    folder = write_folder(tmp_path / "front", PICTURES)
    log = tmp_path / "detections.jsonl"
    whole = collect(folder)
    content = (folder / "frame4.png").read_bytes()
    (folder / "frame4.png").write_bytes(b"not there yet")
    assert collect(folder, log=log).bad_frames == 1
    (folder / "frame4.png").write_bytes(content)
    again = collect(folder, log=log, resume=True)
    assert again.bad_frames == 0 and again.unused == whole.unused


def test_two_runs_at_once_do_not_share_a_log(tmp_path):
    folder = write_folder(tmp_path / "front", PICTURES)
    log = tmp_path / "detections.jsonl"
    with open_recording(folder) as recording, Collector(recording, TARGET, log=log) as collector:
        collector.collect(["front"])
        with pytest.raises(InputError, match="in use by another run"):
            collect(folder, log=log, resume=True)
    assert len(collect(folder, log=log, resume=True).frames) == 12


def test_images_of_another_folder_are_not_taken_for_these(tmp_path):
    """Image files have no time: their paths tell them apart."""
    log = tmp_path / "detections.jsonl"
    collect(write_folder(tmp_path / "a" / "front", PICTURES), log=log)
    with pytest.raises(InputError, match="another recording"):
        collect(write_folder(tmp_path / "b" / "front", PICTURES), log=log, resume=True)


def test_an_image_that_another_has_replaced_is_looked_at_again(tmp_path):
    folder = write_folder(tmp_path / "front", PICTURES)
    log = tmp_path / "detections.jsonl"
    assert "frame4.png" not in collect(folder, log=log).unused
    (folder / "frame0.png").replace(folder / "frame4.png")
    write_folder(tmp_path / "new", [picture(ABSENT)])
    (tmp_path / "new" / "frame0.png").replace(folder / "frame0.png")
    assert "frame4.png" in collect(folder, log=log, resume=True).unused


def test_another_bag_with_the_same_times_is_not_resumed(tmp_path):
    log = tmp_path / "detections.jsonl"
    runs = []
    for shift in (0, 5):
        bag = tmp_path / f"bag{shift}.mcap"
        write_mcap(bag, messages([picture(x=i + shift) for i in range(6)]))
        os.replace(bag, tmp_path / "bag.mcap")
        with open_recording(tmp_path / "bag.mcap") as recording:
            (topic,) = (one.name for one in recording.image_topics())
            with Collector(recording, TARGET, log=log, resume=shift > 0) as collector:
                runs.append(collector.collect([topic])[topic].observations(TARGET.object_points))
    assert runs[0].image_names == runs[1].image_names
    assert (runs[1].pixels - runs[0].pixels == [5, 0]).all()
