"""What every format of another program promises: what is written is read back, by a reader of its own, as it says."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from foreign_readers import PLACE_READERS, READERS, Read

from fisheye_ep_calib.calibration.assessing.stand_in import points_over_image
from fisheye_ep_calib.camera import FAR, FisheyeCamera
from fisheye_ep_calib.formats import FORMATS
from fisheye_ep_calib.pipeline.exporting import export, writable_formats
from fisheye_ep_calib.rotation import rotation_from_vector
from fisheye_ep_calib.storage.camera_file import save_camera
from fisheye_ep_calib.storage.rig_file import places_yaml

CENTRAL = FisheyeCamera(
    (1280, 960), 400, 401, 642.3, 477.7, radial=(0.03, -0.004, 0.001, -0.0002), theta_max=np.radians(80)
)
PUPIL = FisheyeCamera(
    (1280, 960),
    400,
    401,
    642.3,
    477.7,
    skew=0.3,
    radial=(0.03, -0.004, 0.001, -0.0002),
    model="ep_even",
    coefficients=(-0.9e-3, -0.25e-3),
    theta_max=np.radians(80),
)
PLACE = np.eye(4)
PLACE[:3, :3] = rotation_from_vector(np.array([0.1, 0.5, -0.2]))
PLACE[:3, 3] = [0.08, -0.01, 0.02]


def read_back(name: str, paths) -> list[Read]:
    return READERS[name](list(map(Path, paths)))


def error(read: Read, camera: FisheyeCamera, distance: float) -> np.ndarray:
    """(n, 2) px: the reader's pixels less the camera's own, over the image, at a distance."""
    pixels, points = points_over_image(camera, distance)
    return read.project(FAR * points if np.isinf(distance) else points) - pixels


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).sum(axis=-1).mean()))


def test_every_format_has_a_name_a_summary_and_a_direction(format_name) -> None:
    format = FORMATS[format_name]
    assert format.name == format_name and format.summary
    assert format.write is not None or format.read is not None
    assert (format.read is None) == (format.recognises is None)


def test_every_written_format_is_read_back_here() -> None:
    assert set(writable_formats()) == {*READERS, *PLACE_READERS}


def test_a_camera_of_the_formats_own_kind_is_read_back_to_the_pixel(written_format, tmp_path) -> None:
    camera = CENTRAL if written_format != "mrcal" else FisheyeCamera(
        CENTRAL.image_size, 400, 401, 642.3, 477.7, radial=(0.03, -0.004, 0.0, 0.0), model="gennery",
        coefficients=(5e-3, -1e-3, 2e-4), theta_max=np.radians(80),
    )  # fmt: skip
    done = export(camera, written_format, tmp_path / "camera.yaml")
    (read,) = read_back(written_format, done.paths)
    assert read.size == camera.image_size and "camera: the full camera, to rounding" in done.words
    for distance in (0.1, 1.0, np.inf):
        assert np.abs(error(read, camera, distance)).max() < 1e-6, distance


def test_a_pupil_costs_what_the_file_says(written_format, tmp_path) -> None:
    save_camera(tmp_path / "front.yaml", PUPIL)
    done = export(tmp_path / "front.yaml", written_format, tmp_path / "out.yaml")
    (read,) = read_back(written_format, done.paths)
    (told,) = [line for line in done.words if "RMS over the image" in line]
    stated = {far: float(px) for px, far in re.findall(r"([\d.e-]+) px at ([\d.]+ m|infinity)", told)}
    assert list(stated) == ["0.1 m", "0.3 m", "1 m", "10 m", "infinity"]
    for far, px in stated.items():
        found = rms(error(read, PUPIL, np.inf if far == "infinity" else float(far.split()[0])))
        assert found <= 1.001 * px + 1e-6, far
    if written_format == "mrcal":
        assert max(stated.values()) < 0.21 and "the entrance pupil" not in " ".join(done.words)
    else:
        assert stated["0.1 m"] > 2 and "the entrance pupil E(theta)" in " ".join(done.words)
    text = "".join(path.read_text() for path in done.paths)
    assert all(line.replace("--", "- -") in text for line in done.words if line.startswith("front: RMS"))


def test_it_is_nearest_at_the_distance_asked_for(written_format, tmp_path) -> None:
    near = export(PUPIL, written_format, tmp_path / "near.yaml", svp_distance=0.15)
    far = export(PUPIL, written_format, tmp_path / "far.yaml")
    (close,), (away,) = read_back(written_format, near.paths), read_back(written_format, far.paths)
    assert rms(error(close, PUPIL, 0.15)) <= 1.0001 * rms(error(away, PUPIL, 0.15))
    if written_format != "mrcal":
        assert rms(error(close, PUPIL, 0.15)) < 0.3 * rms(error(away, PUPIL, 0.15))


def rig(tmp_path: Path, names: tuple[str, ...]) -> Path:
    """A rig file: each camera stands PLACE from the one before it."""
    places, place = {}, np.eye(4)
    for name in names:
        save_camera(tmp_path / f"{name}.yaml", CENTRAL, name)
        places[name], place = place, place @ PLACE
    text = places_yaml(places)
    for name in names:
        text = text.replace(f"  {name}:\n", f"  {name}:\n    camera_file: {name}.yaml\n    topic: /{name}/image\n")
    (tmp_path / "rig.yaml").write_text(text)
    return tmp_path / "rig.yaml"


def test_a_rigs_cameras_stand_where_they_stand(written_format, tmp_path) -> None:
    most = FORMATS[written_format].most_cameras or 3
    names = ("left", "right", "rear")[:most]
    done = export(rig(tmp_path, names), written_format, tmp_path / "out.yaml")
    found = read_back(written_format, done.paths)
    assert len(found) == len(names)
    place = np.eye(4)
    for name, read in zip(names, found, strict=True):
        np.testing.assert_allclose(read.camera_from_reference, np.linalg.inv(place), atol=1e-7)
        assert read.topic in (None, f"/{name}/image")
        if written_format != "mrcal":
            assert np.abs(error(read, CENTRAL, np.inf)).max() < 1e-6
        place = place @ PLACE


@pytest.mark.parametrize("name", PLACE_READERS)
def test_where_a_rigs_cameras_are_is_read_back(name, tmp_path, command) -> None:
    done = export(rig(tmp_path, ("left", "right", "rear")), name, tmp_path / "out")
    found, place = PLACE_READERS[name](done.paths[0]), np.eye(4)
    assert list(found) == ["right_optical_frame", "rear_optical_frame"]
    for reference_from_camera in found.values():
        place = place @ PLACE
        np.testing.assert_allclose(reference_from_camera, place, atol=1e-12)
    command("export", "left.yaml", "--to", name, "--output", "one").refused(2, "rig")


def test_hyphens_in_names_leave_xml_that_can_be_read(tmp_path) -> None:
    done = export(rig(tmp_path, ("left---a", "right--b")), "urdf", tmp_path / "out")
    links = ElementTree.parse(done.paths[0]).getroot().iter("link")
    assert [link.get("name") for link in links] == ["left---a_optical_frame", "right--b_optical_frame"]


@pytest.mark.parametrize("name", [name for name, one in FORMATS.items() if one.most_cameras])
def test_more_cameras_than_it_holds_are_refused(name, tmp_path, command) -> None:
    most = FORMATS[name].most_cameras
    path = rig(tmp_path, tuple(f"c{number}" for number in range(most + 1)))
    command("export", path, "--to", name, "--output", "x.yaml").refused(2, name, str(most))


def test_by_command_with_json_and_nothing_is_replaced(written_format, tmp_path, command) -> None:
    save_camera(tmp_path / "front.yaml", CENTRAL)
    words = ("export", "front.yaml", "--to", written_format, "--output", "out/there.yaml")
    ended = command(*words, "--json")
    assert ended.code == 0, ended.err
    assert read_back(written_format, ended.json["files"])
    command(*words).refused(2, "--overwrite")
    ended = command(*words, "--overwrite")
    assert ended.code == 0 and "front: not in this file: " in ended.out and "wrote " in ended.out
