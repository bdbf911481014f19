"""Looking for a target in recordings, whatever happens on the way."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_writers import START_NS, messages, write_folder, write_mcap
from numbered_target import ABSENT, CRASHES, ENDLESS, INTERRUPTS, KILLS, SLOW, TARGET, picture

from fisheye_ep_calib.collection import Collector, DetectionRun, FrameChoice
from fisheye_ep_calib.collection.collector import Guide
from fisheye_ep_calib.collection.look import Job
from fisheye_ep_calib.collection.results import FrameResult
from fisheye_ep_calib.collection.workers import FrameWorkers
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.target.detection import Detection

LEFT, RIGHT = "/left/image_raw", "/right/image_raw"


def moving_pictures(count, seed=0):
    generator = np.random.default_rng(seed)
    steps = np.cumsum(generator.normal(0, 1.5, (count, 2)), axis=0)
    places = 5 + np.abs(steps).astype(int) % 40
    return [picture(x=x, y=y, size=4 + i % 3) for i, (x, y) in enumerate(places)]


def collect(path, topics, **options):
    choice = options.pop("choice", None)
    with open_recording(path) as recording, Collector(recording, TARGET, **options) as collector:
        return collector.collect(topics, choice)


@pytest.fixture
def two_cameras(tmp_path):
    left = messages(moving_pictures(400, 1), LEFT)
    right = messages(moving_pictures(300, 2), RIGHT, start_ns=START_NS + 5)
    return write_mcap(tmp_path / "two.mcap", sorted(left + right, key=lambda m: m[1]))


def test_the_result_does_not_depend_on_the_number_of_workers(two_cameras):
    runs = [collect(two_cameras, [LEFT, RIGHT], workers=workers) for workers in (0, 1, 2, 4)]
    for topic, available in ((LEFT, 400), (RIGHT, 300)):
        first = runs[0][topic]
        assert first.available == available and 50 < len(first.frames) <= 150
        expected = first.observations(TARGET.object_points)
        for run in runs[1:]:
            assert [frame.index for frame in run[topic].frames] == [frame.index for frame in first.frames]
            observed = run[topic].observations(TARGET.object_points)
            assert observed.pixels.tobytes() == expected.pixels.tobytes()
            assert observed.image_names == expected.image_names


def shared_for_a_while():
    """Two cameras in step for 300 images; both see the target from the 120th to the 150th, one alone elsewhere."""
    left, right = moving_pictures(300, 1), moving_pictures(300, 2)
    for number in range(300):
        if not 120 <= number < 150:
            (left if number % 2 else right)[number] = picture(ABSENT)
    both = messages(left, LEFT) + messages(right, RIGHT, start_ns=START_NS + 5)
    return sorted(both, key=lambda m: m[1])


def collect_moments(path, most=60, **options):
    moments = np.stack([np.arange(300), np.arange(300)], axis=1)
    moments[200, 1] = -1
    with open_recording(path) as recording, Collector(recording, TARGET, **options) as collector:
        return collector.collect_moments([LEFT, RIGHT], moments, FrameChoice(most))


def test_moments_are_looked_at_together_next_to_those_that_two_cameras_saw(tmp_path):
    path = write_mcap(tmp_path / "two.mcap", shared_for_a_while())
    runs = [collect_moments(path, workers=workers) for workers in (0, 2, 3)]
    looked = [frame.index for frame in runs[0][LEFT].frames]
    assert len(looked) == 60 and {frame.index for frame in runs[0][RIGHT].frames} == set(looked) - {200}
    assert set(range(120, 150)) <= set(looked)
    for run in runs[1:]:
        for topic in (LEFT, RIGHT):
            assert [frame.index for frame in run[topic].frames] == [frame.index for frame in runs[0][topic].frames]
            one, other = (r[topic].observations(TARGET.object_points) for r in (run, runs[0]))
            assert one.pixels.tobytes() == other.pixels.tobytes() and one.image_names == other.image_names


def test_moments_go_on_from_a_log(tmp_path, monkeypatch):
    path, log = write_mcap(tmp_path / "two.mcap", shared_for_a_while()), tmp_path / "log.jsonl"
    whole = collect_moments(path)
    collect_moments(path, most=20, log=log)
    looked = []
    search = FrameWorkers.add
    monkeypatch.setattr(
        FrameWorkers, "add", lambda self, jobs: search(self, (looked.append(job) or job for job in jobs))
    )
    again = collect_moments(path, most=20, log=log, resume=True)
    assert looked == [] and len(again[LEFT].frames) == 20
    resumed = collect_moments(path, log=log, resume=True)
    assert [frame.index for frame in resumed[LEFT].frames] == [frame.index for frame in whole[LEFT].frames]
    assert 0 < len(looked) < sum(len(run.frames) for run in whole.values())


def test_images_not_chosen_are_not_read(two_cameras, monkeypatch):
    read = []
    with open_recording(two_cameras) as recording:
        source = recording._sources[0]
        whole_read = type(source).read
        monkeypatch.setattr(type(source), "read", lambda self, *a: read.append(a) or whole_read(self, *a))
        with Collector(recording, TARGET) as collector:
            runs = collector.collect([LEFT, RIGHT], FrameChoice(max_views=20))
    assert len(read) == sum(len(run.frames) for run in runs.values()) == 40
    assert "380 of 400 not looked at" in runs[LEFT].summary()


@pytest.mark.parametrize("workers", [0, 2])
def test_bad_images_are_counted_and_named(tmp_path, workers):
    folder = write_folder(tmp_path / "front", [picture(), picture(ABSENT), picture(CRASHES), picture(x=30), picture()])
    (folder / "frame4.png").write_bytes(b"\x89PNG\r\n\x1a\nbroken")
    run = collect(folder, ["front"], workers=workers)["front"]
    assert [view.name for view in run.views] == ["frame0.png", "frame3.png"]
    assert run.unused["frame1.png"] == "no target here"
    assert run.unused["frame2.png"] == "the detector failed on it (ValueError: strange)"
    assert "PNG" in run.unused["frame4.png"]
    assert run.bad_frames == 2 and run.image_size == (80, 60)
    assert "found in 2 of 5 images, 2 unreadable" in run.summary()
    observations = run.observations(TARGET.object_points)
    assert observations.image_names == ("frame0.png", "frame3.png") and len(observations.pixels) == 24
    with pytest.raises(InputError, match="front, image frame2.png: the detector failed"):
        collect(folder, ["front"], strict=True)


def test_an_image_that_kills_its_worker_costs_only_itself(tmp_path):
    pictures = [picture(x=i) for i in range(12)]
    pictures[5] = picture(KILLS)
    run = collect(write_folder(tmp_path / "front", pictures), ["front"], workers=2)["front"]
    assert len(run.views) == 11
    assert run.unused == {"frame5.png": "a worker process died on it"}


@pytest.mark.parametrize("workers", [0, 2])
def test_an_image_that_takes_without_end_is_left_out_and_named(tmp_path, monkeypatch, workers):
    monkeypatch.setattr("fisheye_ep_calib.collection.look.LOOK_SECONDS", 0.5)
    pictures = [picture(x=i) for i in range(12)]
    pictures[3] = pictures[8] = picture(ENDLESS)
    began = time.monotonic()
    run = collect(write_folder(tmp_path / "front", pictures), ["front"], workers=workers)["front"]
    assert len(run.views) == 10 and time.monotonic() - began < 60
    assert run.unused == dict.fromkeys(("frame3.png", "frame8.png"), "looking at it takes without end; left out")


def test_workers_that_die_while_idle_cost_nothing(tmp_path):
    folder = write_folder(tmp_path / "front", [picture(x=i) for i in range(4)])
    with open_recording(folder) as recording:
        workers = FrameWorkers(recording, TARGET, 1)
        try:
            workers.add([Job("front", 0)])
            assert workers.next_result().index == 0
            (process,) = multiprocessing.active_children()
            process.kill()
            process.join()
            workers.add([Job("front", index) for index in (1, 2, 3)])
            assert sorted(workers.next_result().index for _ in range(3)) == [1, 2, 3]
            assert workers.next_result() is None
        finally:
            workers.close()


def test_images_of_different_sizes_cost_their_camera_and_no_other(tmp_path):
    write_folder(tmp_path / "rig" / "front", [picture(), picture(), picture(shape=(48, 64))])
    write_folder(tmp_path / "rig" / "rear", [picture()] * 3)
    runs = collect(tmp_path / "rig", ["front", "rear"])
    with pytest.raises(
        InputError,
        match=r"frame0.png is 80 × 60 \(2 of that size\), frame2.png is 64 × 48 \(1",
    ):
        runs["front"].observations(TARGET.object_points)
    assert runs["rear"].observations(TARGET.object_points).view_count == 3


@pytest.mark.parametrize("place", [0, 3, 6])
def test_one_image_of_another_size_is_left_out_and_named(tmp_path, place):
    pictures = [picture(x=i) for i in range(6)]
    pictures.insert(place, picture(shape=(48, 64)))
    folder = write_folder(tmp_path / "front", pictures)
    run = collect(folder, ["front"])["front"]
    said = {f"frame{place}.png": "it is 64 × 48, the others are 80 × 60"}
    assert len(run.views) == 6 and run.unused == said and run.image_size == (80, 60)
    assert f"6 of 7 images, 1 left out (frame{place}.png: it is 64 × 48" in run.summary()
    assert run.observations(TARGET.object_points).image_size == (80, 60)
    with pytest.raises(InputError, match=f"frame{place}.png: it is 64 × 48"):
        collect(folder, ["front"], strict=True)


def test_namesakes_that_are_no_views_are_all_told():
    absent = FrameResult("c", 0, 5, "0.5", (80, 60), Detection(reason="nothing"))
    run = DetectionRun("c", 3, tuple(replace(absent, index=i) for i in range(3)))
    assert run.unused == {"0.5": "nothing", "0.5 (2)": "nothing", "0.5 (3)": "nothing"}


def test_where_nothing_is_found_one_line_says_why(tmp_path):
    run = collect(write_folder(tmp_path / "a", [picture(ABSENT)] * 3), ["a"])["a"]
    with pytest.raises(CalibrationError, match=r"a: the target was found in none of 3 images \(3 ×: no target"):
        run.observations(TARGET.object_points)
    folder = write_folder(tmp_path / "b", [picture()])
    (folder / "frame0.png").write_bytes(b"x")
    with pytest.raises(InputError, match="none of 1 images can be read: the data is neither"):
        collect(folder, ["b"])["b"].observations(TARGET.object_points)


def test_a_second_pass_looks_only_at_views_with_a_pose(tmp_path):
    folder = write_folder(tmp_path / "front", [picture(x=i) if i != 1 else picture(ABSENT) for i in range(4)])
    pose = np.eye(4)
    pose[:2, 3] = 0.25, 0.5
    with open_recording(folder) as recording, Collector(recording, TARGET) as collector:
        run = collector.collect(["front"])["front"]
        again = collector.refine([Guide(run, "camera", {0: pose, 2: pose})])["front"]
        nothing = collector.refine([Guide(run, "nothing", {0: pose})])["front"]
    moved = [b.detection.pixels - a.detection.pixels for a, b in zip(run.views, again.views, strict=True)]
    np.testing.assert_allclose(moved[0], [[0.25, 0.5]] * 12)
    np.testing.assert_allclose(moved[1], 0)
    np.testing.assert_allclose(moved[2], [[0.25, 0.5]] * 12)
    assert len(nothing.views[0].detection) == 12


def test_an_interruption_keeps_what_was_found(tmp_path):
    pictures = [picture(x=i) for i in range(6)]
    pictures[4] = picture(INTERRUPTS)
    run = collect(write_folder(tmp_path / "front", pictures), ["front"])["front"]
    assert run.interrupted and len(run.views) == 4
    assert "interrupted" in run.summary()


SCRIPT = """
import sys
sys.path[:0] = {paths}
from numbered_target import TARGET
from fisheye_ep_calib.collection import Collector
from fisheye_ep_calib.storage.recording import open_recording

if __name__ == "__main__":
    _, folder, log = sys.argv
    with open_recording(folder) as recording, Collector(recording, TARGET, workers=2, log=log) as collector:
        print("started", flush=True)
        run = collector.collect(["front"])["front"]
        print(len(run.views), run.interrupted, flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="sends a signal to a process group")
@pytest.mark.parametrize("found_before", [0, 3], ids=["workers starting", "workers looking"])
def test_ctrl_c_in_a_terminal_ends_workers_without_a_traceback(tmp_path, found_before):
    folder = write_folder(tmp_path / "front", [picture(SLOW, x=i) for i in range(100)])
    script, log = tmp_path / "script.py", tmp_path / "detections.jsonl"
    here = Path(__file__).parent
    script.write_text(SCRIPT.format(paths=[str(here), str(here.parents[1])]))
    process = subprocess.Popen(
        [sys.executable, str(script), str(folder), str(log)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout.readline() == "started\n"
    assert within(60, lambda: log.exists() and log.read_bytes().count(b"\n") > found_before)
    time.sleep(0.2)
    os.killpg(process.pid, signal.SIGINT)
    out, errors = process.communicate(timeout=60)
    views, interrupted = out.split()
    assert interrupted == "True" and found_before <= int(views) < 100
    assert errors == ""
    assert within(10, lambda: not group_exists(process.pid))


@pytest.mark.skipif(os.name != "posix", reason="sends a signal to a process group")
def test_a_second_ctrl_c_does_not_break_off_the_clean_up(tmp_path, monkeypatch):
    folder = write_folder(tmp_path / "front", [picture(SLOW, x=i) for i in range(100)])
    with open_recording(folder) as recording:
        workers = FrameWorkers(recording, TARGET, 2)
        workers.add([Job("front", index) for index in range(100)])
        workers.next_result()
        ended = workers._end_pool
        monkeypatch.setattr(workers, "_end_pool", lambda: (os.kill(os.getpid(), signal.SIGINT), ended()))
        scratch, started = workers._scratch.path, time.monotonic()
        workers.close()
        assert time.monotonic() - started < 5 and not scratch.exists()
    assert multiprocessing.active_children() == []
    with pytest.raises(KeyboardInterrupt):  # heard again
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1)


def within(seconds, condition) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False


def group_exists(group) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
