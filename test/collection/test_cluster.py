"""Looking on a Dask cluster: the same result as here, whatever happens to its workers."""

import os
import signal
import sys
import threading
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from bag_writers import messages, write_folder, write_mcap
from dask_processes import scheduler
from dask_processes import workers as any_workers
from numbered_target import ABSENT, CRASHES, ENDLESS, KILLS, SLOW, TARGET, picture

from fisheye_ep_calib.collection import Collector, FrameChoice, cluster
from fisheye_ep_calib.collection.cluster import ClusterWorkers
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.storage.recording import open_recording

pytest.importorskip("distributed")

workers = partial(any_workers, paths=[Path(__file__).parent])  # where the detector of these tests is


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory):
    with scheduler(tmp_path_factory.mktemp("cluster")) as address, workers(address, 2):
        yield address


def collect(path, topics, choice=None, **options):
    with open_recording(path) as recording, Collector(recording, TARGET, **options) as collector:
        return collector.collect(topics, choice)


def same(one, other):
    assert [frame.index for frame in one.frames] == [frame.index for frame in other.frames]
    assert one.unused == other.unused
    pixels = [run.observations(TARGET.object_points).pixels.tobytes() for run in (one, other)]
    return pixels[0] == pixels[1]


def moving(count, kind=4):
    steps = np.cumsum(np.random.default_rng(3).normal(0, 1.5, (count, 2)), axis=0)
    return [picture(x=x, y=y, size=kind) for x, y in 5 + np.abs(steps).astype(int) % 40]


def test_a_cluster_finds_the_same_to_the_bit(two_workers, tmp_path, monkeypatch):
    write_mcap(tmp_path / "a.mcap", messages(moving(300), "/left/image_raw"))
    monkeypatch.chdir(tmp_path)
    topics = ["/left/image_raw"]
    (here,) = collect("a.mcap", topics).values()
    (there,) = collect("a.mcap", topics, scheduler=two_workers).values()  # a relative path, from another folder
    assert same(here, there) and 50 < len(here.views) <= 150


def test_moments_of_several_cameras_too(two_workers, tmp_path):
    topics = ["/left/image_raw", "/right/image_raw"]
    both = [message for topic in topics for message in messages(moving(60), topic)]
    path = write_mcap(tmp_path / "two.mcap", sorted(both, key=lambda message: message[1]))
    moments = np.stack([np.arange(60), np.arange(60)], axis=1)
    runs = []
    for options in ({}, {"scheduler": two_workers}):
        with open_recording(path) as recording, Collector(recording, TARGET, **options) as collector:
            runs.append(collector.collect_moments(topics, moments, FrameChoice(20)))
    assert all(len(runs[0][topic].frames) == 20 and same(runs[0][topic], runs[1][topic]) for topic in topics)


def test_bad_images_are_counted_and_named_there_too(two_workers, tmp_path):
    folder = write_folder(tmp_path / "front", [picture(), picture(ABSENT), picture(CRASHES), picture(x=30), picture()])
    (folder / "frame4.png").write_bytes(b"\x89PNG\r\n\x1a\nbroken")
    assert same(*(collect(folder, ["front"], scheduler=one)["front"] for one in (None, two_workers)))


def test_a_second_pass_on_the_cluster(two_workers, tmp_path):
    from fisheye_ep_calib.collection.collector import Guide

    folder = write_folder(tmp_path / "front", [picture(x=i) for i in range(4)])
    pose = np.eye(4)
    pose[:2, 3] = 0.25, 0.5
    with open_recording(folder) as recording, Collector(recording, TARGET, scheduler=two_workers) as collector:
        run = collector.collect(["front"])["front"]
        again = collector.refine([Guide(run, "camera", {0: pose})])["front"]
    np.testing.assert_allclose(again.views[0].detection.pixels - run.views[0].detection.pixels, [[0.25, 0.5]] * 12)


def test_a_worker_that_is_killed_costs_no_image(tmp_path):
    folder = write_folder(tmp_path / "front", [picture(SLOW, x=i % 40) for i in range(16)])
    here = collect(folder, ["front"], FrameChoice(every=1), workers=2)["front"]
    log = tmp_path / "log.jsonl"
    with scheduler(tmp_path) as address, workers(address, 2) as started:

        def kill_one():
            end = time.monotonic() + 60
            while time.monotonic() < end and not (log.exists() and log.read_bytes().count(b"\n") > 4):
                time.sleep(0.02)
            os.kill(started[0].pid, signal.SIGKILL)

        killer = threading.Thread(target=kill_one)
        killer.start()
        there = collect(folder, ["front"], FrameChoice(every=1), scheduler=address, log=log)["front"]
        killer.join()
        assert started[0].poll() == -signal.SIGKILL and started[1].poll() is None
    assert same(here, there) and len(there.views) == 16


def test_another_version_is_named_at_once():
    own = cluster._versions()
    cluster._refuse_other_versions({"the scheduler": own, "worker a": own})
    with pytest.raises(InputError, match="worker a has numpy 0.9, this program .*the same versions everywhere"):
        cluster._refuse_other_versions({"the scheduler": own, "worker a": {**own, "numpy": "0.9"}})


@pytest.mark.slow
def test_an_image_that_kills_its_workers_costs_only_itself(tmp_path):
    pictures = [picture(x=i) for i in range(12)]
    pictures[5] = picture(KILLS)
    folder = write_folder(tmp_path / "front", pictures)
    with scheduler(tmp_path) as address, workers(address, 2, nanny=True):
        run = collect(folder, ["front"], scheduler=address)["front"]
    assert len(run.views) == 11 and run.unused == {"frame5.png": "a worker process died on it"}


@pytest.mark.slow
def test_a_cluster_that_loses_all_its_workers_ends_the_search(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "ANSWER_SECONDS", 1)
    folder = write_folder(tmp_path / "front", [picture(KILLS)] * 3)
    with scheduler(tmp_path) as address, workers(address, 1):
        with pytest.raises(CalibrationError, match="has no workers any more"):
            collect(folder, ["front"], scheduler=address)


def test_what_is_no_cluster_is_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 1)
    with open_recording(write_folder(tmp_path / "front", [picture()])) as recording:
        for address in ("tcp://127.0.0.1:9", "nonsense", "", "udp://here:1", "tcp://nowhere.invalid:8786"):
            with pytest.raises(InputError, match=r"no Dask .*'dask scheduler'|no address such as") as told:
                ClusterWorkers(recording, TARGET, address)
            assert "\n" not in str(told.value)
        with scheduler(tmp_path) as address, pytest.raises(InputError, match="has no workers; start some"):
            ClusterWorkers(recording, TARGET, address)


def test_a_recording_that_workers_cannot_see_is_refused(two_workers, tmp_path):
    with open_recording(write_folder(tmp_path / "front", [picture()])) as recording:
        (tmp_path / "front").rename(tmp_path / "moved")
        with pytest.raises(InputError, match="has no .*/front: every worker must see the recording at the same path"):
            ClusterWorkers(recording, TARGET, two_workers)


def test_without_the_package_it_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with open_recording(write_folder(tmp_path / "front", [picture()])) as recording:
        with pytest.raises(InputError, match=r"pip install 'fisheye_ep_calib\[cluster\]'"):
            ClusterWorkers(recording, TARGET, "tcp://127.0.0.1:8786")


@pytest.mark.slow
def test_an_image_without_end_is_named_and_its_worker_replaced(tmp_path):
    pictures = [picture(x=i) for i in range(8)]
    pictures[3] = picture(ENDLESS)
    folder = write_folder(tmp_path / "front", pictures)
    with scheduler(tmp_path) as address, workers(address, 1, nanny=True):
        run = collect(folder, ["front"], scheduler=address)["front"]
    assert len(run.views) == 7 and run.unused == {"frame3.png": "looking at it takes without end; left out"}


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["scheduler", "worker"])
def test_what_is_lost_for_good_ends_in_one_line_and_is_gone_on_from(tmp_path, monkeypatch, lost):
    """The processes die as the search is under way; what was found is in the log, and the whole is the same."""
    monkeypatch.setattr(cluster, "ANSWER_SECONDS", 1)
    folder = write_folder(tmp_path / "front", [picture(SLOW, x=i % 40) for i in range(16)])
    whole = collect(folder, ["front"], FrameChoice(every=1), workers=2)["front"]
    log, started = tmp_path / "log.jsonl", []
    with scheduler(tmp_path, started) as address, workers(address, 1) as working:

        def kill():
            end = time.monotonic() + 60
            while time.monotonic() < end and not (log.exists() and log.read_bytes().count(b"\n") > 4):
                time.sleep(0.02)
            os.kill((started if lost == "scheduler" else working)[0].pid, signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        with pytest.raises(CalibrationError, match="is lost" if lost == "scheduler" else "has no workers any more"):
            collect(folder, ["front"], FrameChoice(every=1), scheduler=address, log=log)
        killer.join()
    assert 4 < log.read_bytes().count(b"\n") < 16
    assert same(whole, collect(folder, ["front"], FrameChoice(every=1), workers=2, log=log, resume=True)["front"])
