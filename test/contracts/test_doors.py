"""Every kind of target through every door: the same points to the bit, and a camera near the true one.

The node, which chooses views by itself, is in test/ros.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from bag_writers import WRITERS, messages, write_folder
from registered_targets import CAMERA, check_near_truth, imaging, named_target, spread_views

from fisheye_ep_calib import Observations, load_camera
from fisheye_ep_calib.calibration import CalibrationResult
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.collection import Collector
from fisheye_ep_calib.collection.collector import Guide
from fisheye_ep_calib.pipeline import calibrate_recording
from fisheye_ep_calib.simulation import render
from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.target import Detection, Target
from fisheye_ep_calib.target.registry import TARGETS

TOPIC = "/front/image_raw"
VIEWS = 10


@dataclass(frozen=True)
class Scene:
    """A target, its file, and images of it: in a folder, and as they are."""

    target: Target
    file: Path
    folder: Path
    images: list[np.ndarray]


@pytest.fixture(scope="module")
def scene(target_kind, tmp_path_factory) -> Scene:
    place = tmp_path_factory.mktemp(target_kind)
    target, keys = named_target(target_kind)
    images = [render(CAMERA, target, pose, imaging(i)) for i, pose in enumerate(spread_views(target, VIEWS))]
    file = place / "board.yaml"
    file.write_text(yaml.safe_dump(keys))
    return Scene(target, file, write_folder(place / "front", images, name="frame{:02d}"), images)


@pytest.fixture(scope="module")
def alone(scene) -> CalibrationResult:
    """From the folder, looked at in this process."""
    return calibrate_recording(scene.folder, scene.target, model="ep_even", workers=1)["front"]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory) -> Iterator[str]:
    """A Dask cluster of two workers, which can import what is registered from elsewhere."""
    pytest.importorskip("distributed")
    from dask_processes import scheduler, workers

    modules = [sys.modules[kind.__module__] for kind in TARGETS.values()]
    paths = [Path(module.__file__ or "").parent for module in modules if "." not in module.__name__]
    with scheduler(tmp_path_factory.mktemp("cluster")) as address, workers(address, 2, paths=paths):
        yield address


def same_bits(one: Observations, other: Observations) -> bool:
    fields = ("image_index", "point_index", "pixels")
    return all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in fields)


def first_look(recording, target: Target, topic: str) -> Observations:
    with open_recording(recording) as opened, Collector(opened, target) as collector:
        return collector.collect([topic])[topic].observations(target.object_points)


def test_a_folder_gives_the_true_camera(scene, alone) -> None:
    assert alone.views == VIEWS and len(alone.observations.pixels) > 0.8 * VIEWS * len(scene.target.object_points)
    check_near_truth(alone.camera)


def test_the_command_with_two_workers_and_a_bag_gives_the_same(scene, alone, command, tmp_path) -> None:
    bag = WRITERS[".mcap"](tmp_path / "bag.mcap", messages(scene.images, TOPIC))
    words = ("--target", scene.file, "--model", "ep_even", "--no-report", "--workers", 2)
    ended = command("calibrate", bag, *words, "--topic", f"front={TOPIC}", "--output", "out", "--json")
    assert ended.code == 0, ended.err
    said = ended.json["cameras"]["front"]
    assert (said["views"], said["points"]) == (alone.views, alone.points)
    assert same_bits(Observations.load("out/observations/front.npz"), alone.observations)
    camera = load_camera(said["yaml"])
    np.testing.assert_allclose(camera.parameters, alone.camera.parameters, rtol=0, atol=1e-9)


def test_a_cluster_gives_the_same(scene, alone, cluster) -> None:
    there = calibrate_recording(scene.folder, scene.target, model="ep_even", scheduler=cluster)["front"]
    assert same_bits(there.observations, alone.observations)
    np.testing.assert_allclose(there.camera.parameters, alone.camera.parameters, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_what_else_is_estimated_is_the_same_through_every_door(scene, command, cluster, tmp_path) -> None:
    """A folder with one worker, a bag with two, and a cluster; the lens is not symmetric about its axis."""
    field = tuple(np.random.default_rng(5).normal(0, 1.0, len(LENS_FIELD.coefficient_names)).tolist())
    askew = replace(CAMERA, extras={"lens_field": field})
    poses = enumerate(spread_views(scene.target, VIEWS))
    images = [render(askew, scene.target, pose, imaging(i)) for i, pose in poses]
    folder, bag = (
        write_folder(tmp_path / "front", images),
        WRITERS[".mcap"](tmp_path / "bag.mcap", messages(images, TOPIC)),
    )
    options = {"flex": True, "rolling_shutter": True, "lens_field": True, "board_shape": "free"}
    one = calibrate_recording(folder, scene.target, model="ep_even", workers=1, **options)["front"]
    there = calibrate_recording(folder, scene.target, model="ep_even", scheduler=cluster, **options)["front"]
    words = ("--flex", "--rolling-shutter", "--lens-field", "--board-shape", "free", "--no-report", "--json")
    words = (*words, "--topic", f"front={TOPIC}", "--model", "ep_even", "--workers", 2)
    said = command("calibrate", bag, "--target", scene.file, *words)
    assert said.code == 0, said.err
    assert "lens_field" in one.camera.extras
    for camera in (there.camera, load_camera(said.json["cameras"]["front"]["yaml"])):
        np.testing.assert_allclose(camera.parameters, one.camera.parameters, rtol=1e-9, atol=1e-9)


def test_what_the_second_look_gives_up_is_told_through_every_door(scene, tmp_path) -> None:
    """A point of each view is put where it is not, and found elsewhere by the second look: it is given up."""
    bag = WRITERS[".mcap"](tmp_path / "bag.mcap", messages(scene.images[:4], TOPIC))
    images = write_folder(tmp_path / "front", scene.images[:4])
    told = []
    for source, topic, workers in ((images, "front", 0), (images, "front", 2), (bag, TOPIC, 0), (bag, TOPIC, 2)):
        with open_recording(source) as opened, Collector(opened, scene.target, workers=workers) as collector:
            run = collector.collect([topic])[topic]
            frames = tuple(replace(frame, detection=_one_moved(frame.detection)) for frame in run.frames)
            poses = dict(enumerate(spread_views(scene.target, VIEWS)[:4]))
            again = collector.refine([Guide(replace(run, frames=frames), CAMERA, poses)])[topic]
        told.append((again.observations(scene.target.object_points), again.points_given_up, again.summary()))
    for observations, given_up, summary in told:
        assert same_bits(observations, told[0][0]) and given_up == told[0][1] and sum(given_up.values()) >= 3
        assert f"{sum(given_up.values())} points of the first look given up: " in summary


def _one_moved(found: Detection) -> Detection:
    pixels = found.pixels.copy()
    pixels[len(found) // 2] += [1.6, 1.2]
    return replace(found, pixels=pixels)


def test_every_format_of_bags_gives_the_same(scene, tmp_path) -> None:
    images = scene.images[:3]
    here = first_look(write_folder(tmp_path / "front", images), scene.target, "front")
    assert len(here.pixels) > 2 * len(scene.target.object_points)
    for suffix, write in WRITERS.items():
        bag = write(tmp_path / f"bag{suffix}", messages(images, TOPIC))
        assert same_bits(first_look(bag, scene.target, TOPIC), here), suffix


@pytest.mark.slow
def test_found_judged_and_told_by_the_other_commands(scene, alone, command) -> None:
    found = command("detect", scene.folder, "--target", scene.file, "--workers", 2, "--output", "found", "--overlay")
    assert found.code == 0, found.err
    assert same_bits(Observations.load("found/front.npz"), first_look(scene.folder, scene.target, "front"))
    assert len(list(Path("found/front_overlay").glob("*.png"))) == VIEWS
    calibrated = command("calibrate", "found/front.npz", "--output", "out", "--json")
    assert calibrated.code == 0 and Path("out/report.html").exists(), calibrated.err
    check_near_truth(load_camera(calibrated.json["cameras"]["front"]["yaml"]))
    judged = command("evaluate", "out/front.yaml", scene.folder, "--target", scene.file, "--workers", 2, "--json")
    assert judged.code == 0, judged.err
    assert judged.json["views"] == VIEWS and judged.json["rms_px"] < 0.1
