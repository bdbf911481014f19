"""What is accepted is on disk at once, and a camera's state survives whatever happens to its files."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.live import view_store
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.outcome import outcome_of_file
from fisheye_ep_calib.live.session import CameraSession, Limits, Verdict
from fisheye_ep_calib.planning.view_selection import Novelty
from fisheye_ep_calib.storage.observation_file import load_observations
from fisheye_ep_calib.target import Detection, parse_target

SIZE = (1280, 800)
TARGET = parse_target({"type": "chessboard", "columns": 6, "rows": 5, "spacing": 0.02})


def sighting(column: int, row: int = 0, name: str = "", size: tuple[int, int] = SIZE) -> Sighting:
    """The board at one of many places, flat on."""
    points = TARGET.object_points[:, :2] * 2000 + np.array([20 + 150 * column, 20 + 100 * row])
    index = np.arange(len(points))
    return Sighting(name or f"{column}.{row}", size, Detection(index, points))


def session(folder: Path, **limits) -> CameraSession:
    return CameraSession("front", TARGET, folder, Limits(**limits))


def written_camera(folder: Path) -> Path:
    """A camera_info YAML such as camera_calibration writes."""
    matrix = "{rows: 3, cols: 3, data: [300, 0, 640, 0, 300, 400, 0, 0, 1]}"
    path = folder / "before.yaml"
    path.write_text(
        f"camera_name: front\nimage_width: {SIZE[0]}\nimage_height: {SIZE[1]}\ncamera_matrix: {matrix}\n"
        "distortion_model: equidistant\n"
        "distortion_coefficients: {rows: 1, cols: 4, data: [0.01, 0, 0, 0]}\n"
    )
    return path


def test_a_kept_view_is_on_disk_when_it_is_reported(tmp_path: Path) -> None:
    camera = session(tmp_path)
    for column in range(3):
        assert camera.consider(sighting(column)) is Verdict.KEPT
        saved = load_observations(camera.observation_file)
        assert saved.view_count == column + 1
        assert saved.image_names[column] == f"{column}.0"
        assert saved.image_size == SIZE
    np.testing.assert_allclose(saved.object_points, TARGET.object_points)


def test_what_is_not_kept_says_why(tmp_path: Path) -> None:
    camera = session(tmp_path, maximum_views=2)
    assert camera.consider(Sighting("a", SIZE, Detection(reason="no board"))) is Verdict.NOT_FOUND
    few = Detection(np.arange(4), TARGET.object_points[:4, :2] * 1000)
    assert camera.consider(Sighting("b", SIZE, few)) is Verdict.TOO_FEW_POINTS
    assert camera.consider(sighting(0)) is Verdict.KEPT
    assert camera.consider(sighting(0, name="again")) is Verdict.NOT_NEW
    assert camera.consider(sighting(1, size=(640, 480))) is Verdict.OTHER_SIZE
    assert camera.consider(sighting(1)) is Verdict.KEPT
    assert camera.consider(sighting(2)) is Verdict.FULL
    assert (camera.counters.searched, camera.counters.found) == (7, 6)


def test_a_new_session_goes_on_where_the_last_one_ended(tmp_path: Path) -> None:
    before = session(tmp_path)
    for column in range(4):
        before.consider(sighting(column))
    after = session(tmp_path)
    assert after.start(resume=True) == 4
    assert after.consider(sighting(2, name="known")) is Verdict.NOT_NEW
    assert after.consider(sighting(4)) is Verdict.KEPT
    assert [view.name for view in after.views] == ["0.0", "1.0", "2.0", "3.0", "4.0"]
    np.testing.assert_array_equal(after.observations().pixels[:30], before.observations().pixels[:30])


def test_not_resuming_and_reset_set_the_earlier_views_aside(tmp_path: Path) -> None:
    before = session(tmp_path)
    before.consider(sighting(0))
    after = session(tmp_path)
    assert after.start(resume=False) == 0
    after.consider(sighting(1))
    assert after.reset() == 1
    assert not after.observation_file.exists()
    kept = sorted(load_observations(path).image_names[0] for path in tmp_path.glob("front.*.npz"))
    assert kept == ["0.0", "1.0"]


def test_views_of_another_target_are_refused(tmp_path: Path) -> None:
    session(tmp_path).consider(sighting(0))
    other = parse_target({"type": "chessboard", "columns": 6, "rows": 5, "spacing": 0.03})
    with pytest.raises(InputError, match="another target"):
        CameraSession("front", other, tmp_path).start(resume=True)


def test_a_refusing_disk_loses_nothing(tmp_path: Path) -> None:
    blocked = tmp_path / "results"
    blocked.write_text("a file where the folder should be")
    camera = session(blocked)
    with pytest.raises(CalibrationError, match="results"):
        camera.consider(sighting(0))
    assert camera.unwritten and len(camera.views) == 1
    with pytest.raises(CalibrationError):
        camera.write()
    blocked.unlink()
    camera.write()
    assert not camera.unwritten
    assert load_observations(camera.observation_file).view_count == 1


def test_a_reset_that_fails_forgets_nothing(tmp_path: Path, monkeypatch) -> None:
    camera = session(tmp_path)
    camera.consider(sighting(0))
    monkeypatch.setattr(Path, "rename", lambda *_: (_ for _ in ()).throw(PermissionError(13, "Permission denied")))
    generation = camera.generation
    with pytest.raises(CalibrationError, match="cannot rename"):
        camera.reset()
    assert len(camera.views) == 1 and camera.generation == generation
    camera.consider(sighting(1))
    assert load_observations(camera.observation_file).view_count == 2


def test_counting_does_not_wait_for_the_disk(tmp_path: Path, monkeypatch) -> None:
    """Images are counted in callbacks, which must not wait."""
    camera, writing, counted = session(tmp_path), threading.Event(), threading.Event()
    written = view_store.save_observations
    monkeypatch.setattr(view_store, "save_observations", lambda *a: (writing.set(), counted.wait(10), written(*a)))
    thread = threading.Thread(target=camera.consider, args=(sighting(0),))
    thread.start()
    assert writing.wait(10)
    counter = threading.Thread(target=lambda: (camera.count(received=1), counted.set()))
    counter.start()
    assert counted.wait(5)
    thread.join()
    counter.join()
    assert camera.counters.searched == 1 and len(camera.views) == 1


def test_a_result_of_views_that_are_gone_is_not_adopted(tmp_path: Path) -> None:
    camera = session(tmp_path)
    camera.consider(sighting(0))
    generation = camera.generation
    camera.reset()
    outcome = outcome_of_file(written_camera(tmp_path))
    assert not camera.adopt(outcome, generation)
    assert camera.adopt(outcome, camera.generation)
    camera.write()
    assert camera.camera_file.read_text() == outcome.yaml


def test_novelty_is_a_setting(tmp_path: Path) -> None:
    camera = session(tmp_path, novelty=Novelty(position=0.5))
    assert [camera.consider(sighting(column)) for column in (0, 1)] == [Verdict.KEPT, Verdict.NOT_NEW]
