"""What is accepted is on disk at once, and a camera's views survive whatever happens to their file."""

from __future__ import annotations

import shutil
import subprocess
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.camera import LiveCamera
from fisheye_ep_calib.live.camera_views import CameraViews, Verdict
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.settings import Limits, Tuning
from fisheye_ep_calib.live.subject import Workplace
from fisheye_ep_calib.planning.view_selection import Novelty
from fisheye_ep_calib.storage import kept_file
from fisheye_ep_calib.storage.observation_file import load_observations
from fisheye_ep_calib.target import Detection, parse_target

SIZE = (1280, 800)
TARGET = parse_target({"type": "chessboard", "columns": 6, "rows": 5, "spacing": 0.02})


SMALL_DISK = 65536  # bytes


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own that is soon full."""
    command = ["mount", "-t", "tmpfs", "-o", f"size={SMALL_DISK}", "tmpfs", str(tmp_path)]
    try:
        mounted = subprocess.run(command, capture_output=True).returncode == 0
    except OSError:
        mounted = False
    if not mounted:
        pytest.skip("mounting a file system is not allowed here")
    yield tmp_path
    subprocess.run(["umount", str(tmp_path)], check=True)


def sighting(column: int, row: int = 0, name: str = "", size: tuple[int, int] = SIZE) -> Sighting:
    """The board at one of many places, flat on."""
    points = TARGET.object_points[:, :2] * 2000 + np.array([20 + 150 * column, 20 + 100 * row])
    index = np.arange(len(points))
    return Sighting(name or f"{column}.{row}", size, Detection(index, points))


def views(folder: Path, **limits) -> CameraViews:
    return CameraViews("front", TARGET, folder / "front.npz", Limits(**limits))


def consider(views: CameraViews, seen: Sighting) -> Verdict:
    """The verdict on what is seen now."""
    return views.consider(seen, views.generation)


def test_a_kept_view_is_on_disk_when_it_is_reported(tmp_path: Path) -> None:
    camera = views(tmp_path)
    for column in range(3):
        assert consider(camera, sighting(column)) is Verdict.KEPT
        saved = load_observations(camera.file)
        assert saved.view_count == column + 1
        assert saved.image_names[column] == f"{column}.0"
        assert saved.image_size == SIZE
    np.testing.assert_allclose(saved.object_points, TARGET.object_points)


def test_a_view_has_a_number_also_where_names_come_back(tmp_path: Path) -> None:
    """A driver that stamps nothing names all alike."""
    front = views(tmp_path)
    for number, name in enumerate(("a", "b", "b", "a"), 1):
        assert consider(front, sighting(number, name=name)) is Verdict.KEPT
        assert front.number_of(name) == number
    assert front.number_of("c") == 0


def test_what_is_not_kept_says_why(tmp_path: Path) -> None:
    camera = views(tmp_path, maximum_views=2)
    assert consider(camera, Sighting("a", SIZE, Detection(reason="no board"))) is Verdict.NOT_FOUND
    few = Detection(np.arange(4), TARGET.object_points[:4, :2] * 1000)
    assert consider(camera, Sighting("b", SIZE, few)) is Verdict.TOO_FEW_POINTS
    assert consider(camera, sighting(0)) is Verdict.KEPT
    assert consider(camera, sighting(0, name="again")) is Verdict.NOT_NEW
    assert consider(camera, sighting(1, size=(640, 480))) is Verdict.OTHER_SIZE
    assert consider(camera, sighting(1)) is Verdict.KEPT
    assert consider(camera, sighting(2)) is Verdict.FULL
    assert (camera.counters.searched, camera.counters.detected) == (7, 6)


def test_a_new_session_goes_on_where_the_last_one_ended(tmp_path: Path) -> None:
    before = views(tmp_path)
    for column in range(4):
        consider(before, sighting(column))
    after = views(tmp_path)
    assert after.start(resume=True) == 4
    assert consider(after, sighting(2, name="known")) is Verdict.NOT_NEW
    assert consider(after, sighting(4)) is Verdict.KEPT
    assert [view.name for view in after.kept] == ["0.0", "1.0", "2.0", "3.0", "4.0"]
    np.testing.assert_array_equal(after.observations().pixels[:30], before.observations().pixels[:30])


def test_not_resuming_and_reset_set_the_earlier_views_aside(tmp_path: Path) -> None:
    before = views(tmp_path)
    consider(before, sighting(0))
    after = views(tmp_path)
    assert after.start(resume=False) == 0
    consider(after, sighting(1))
    assert after.forget() == 1
    assert not after.file.exists()
    kept = sorted(load_observations(path).image_names[0] for path in tmp_path.glob("front.*.npz"))
    assert kept == ["0.0", "1.0"]


def test_views_of_another_target_are_refused(tmp_path: Path) -> None:
    consider(views(tmp_path), sighting(0))
    other = parse_target({"type": "chessboard", "columns": 6, "rows": 5, "spacing": 0.03})
    with pytest.raises(InputError, match="another target"):
        CameraViews("front", other, tmp_path / "front.npz").start(resume=True)


def test_a_refusing_disk_loses_nothing(tmp_path: Path) -> None:
    blocked = tmp_path / "results"
    blocked.write_text("a file where the folder should be")
    camera = views(blocked)
    with pytest.raises(CalibrationError, match="results"):
        consider(camera, sighting(0))
    assert camera.unwritten and len(camera.kept) == 1
    with pytest.raises(CalibrationError):
        camera.write()
    blocked.unlink()
    camera.write()
    assert not camera.unwritten
    assert load_observations(camera.file).view_count == 1


def test_a_refused_save_or_a_removed_folder_is_made_good_as_soon_as_the_disk_is_back(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    camera = views(folder)
    for column in range(5):
        consider(camera, sighting(column))
    shutil.rmtree(folder)
    assert camera.unwritten and camera.gone
    folder.write_text("in the way")
    for again in (True, False):
        with pytest.raises(CalibrationError, match="results"):
            camera.write(again)
        assert camera.unwritten
    folder.unlink()
    camera.write()
    assert not camera.unwritten and load_observations(camera.file).view_count == 5
    camera.file.write_bytes(camera.file.read_bytes()[:100])
    camera.write()
    assert load_observations(camera.file).view_count == 5


def test_a_full_disk_costs_nothing_that_is_kept(small_disk: Path) -> None:
    camera = views(small_disk)
    filler = small_disk / "filler"
    filler.write_bytes(bytes(SMALL_DISK))
    for column in range(5):
        with pytest.raises(CalibrationError, match="No space left"):
            consider(camera, sighting(column))
    assert camera.unwritten and len(camera.kept) == 5
    assert not any(path.name.endswith((".npz", ".tmp")) for path in small_disk.iterdir())
    filler.unlink()
    camera.write()
    assert not camera.unwritten and load_observations(camera.file).view_count == 5


def test_a_reset_that_fails_forgets_nothing(tmp_path: Path, monkeypatch) -> None:
    camera = views(tmp_path)
    consider(camera, sighting(0))
    monkeypatch.setattr(Path, "rename", lambda *_: (_ for _ in ()).throw(PermissionError(13, "Permission denied")))
    generation = camera.generation
    with pytest.raises(CalibrationError, match="cannot rename"):
        camera.forget()
    assert len(camera.kept) == 1 and camera.generation == generation
    consider(camera, sighting(1))
    assert load_observations(camera.file).view_count == 2


def test_counting_does_not_wait_for_the_disk(tmp_path: Path, monkeypatch) -> None:
    """Images are counted in callbacks, which must not wait."""
    camera, writing, counted = views(tmp_path), threading.Event(), threading.Event()
    written = kept_file.atomic_write
    monkeypatch.setattr(kept_file, "atomic_write", lambda *a: (writing.set(), counted.wait(10), written(*a)))
    thread = threading.Thread(target=consider, args=(camera, sighting(0)))
    thread.start()
    assert writing.wait(10)
    counter = threading.Thread(target=lambda: (camera.count(received=1), counted.set()))
    counter.start()
    assert counted.wait(5)
    thread.join()
    counter.join()
    assert camera.counters.searched == 1 and len(camera.kept) == 1


def test_what_was_seen_before_a_reset_is_not_kept_after_it(tmp_path: Path) -> None:
    """A worker may look at a frame, or another camera ask for a view, while all is being forgotten."""
    camera = views(tmp_path)
    consider(camera, sighting(0))
    before, view = camera.generation, camera.kept[0]
    camera.forget()
    assert camera.consider(sighting(1), before) is Verdict.FORGOTTEN
    assert not camera.keep(view, SIZE, before)
    assert camera.kept == () and not camera.file.exists()
    assert camera.keep(view, SIZE, camera.generation)


def test_an_image_of_another_size_changes_nothing_of_what_is_known_of_the_camera(tmp_path: Path) -> None:
    workplace = Workplace(None, Announcer(print, print), Tuning, lambda: None)  # type: ignore[arg-type]
    camera = LiveCamera(views(tmp_path), "ep_odd", workplace, lambda outcome: None)

    def see(light: np.ndarray, seen: Sighting) -> None:
        camera.searched(replace(seen, light=light), consider(camera.views, seen))

    see(np.full((40, 64), 200, np.uint8), sighting(0))
    wanted, sight = camera.guide.wanted, camera.seeing.sight()
    assert wanted is not None
    for number in range(25):
        stray = Sighting(f"stray {number}", (1, 1), Detection())
        see(np.zeros((1, 1), np.uint8), stray if number % 2 else sighting(1, size=(640, 400)))
    assert camera.guide.wanted is wanted and camera.seeing.image_size == SIZE
    assert (camera.seeing.sight().lit == sight.lit).all()


def test_novelty_is_a_setting(tmp_path: Path) -> None:
    camera = views(tmp_path, novelty=Novelty(position=0.5))
    assert [consider(camera, sighting(column)) for column in (0, 1)] == [Verdict.KEPT, Verdict.NOT_NEW]
