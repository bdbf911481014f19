"""The commands detect and target, as a user calls them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.simulation import Imaging, look_pose, paper_camera, paper_target, render
from fisheye_ep_calib.simulation.clutter import clutter_image

DISCS = "type: circle_grid\ncolumns: 11\nrows: 7\nspacing: 0.012\nradius: 0.004\n"


@pytest.fixture
def folder(tmp_path):
    """Four images: a board, a blurred one, none, and one that is no image; the board's file beside them."""
    camera, target = paper_camera(), paper_target()
    images = tmp_path / "images"
    images.mkdir()
    near, far = look_pose(target, 0.9, 0.4, 0.12, tilt=0.4), look_pose(target, 0.3, 0.4, 0.35)
    cv2.imwrite(str(images / "board.png"), render(camera, target, near, Imaging(blur=0.8, noise=2, texture=30)))
    cv2.imwrite(str(images / "blurred.png"), render(camera, target, far, Imaging(blur=18, noise=2, texture=30)))
    cv2.imwrite(str(images / "clutter.png"), cv2.resize(clutter_image(0), (2048, 2048)))
    (images / "damaged.png").write_bytes(b"\x89PNG\r\n\x1a\nno image")
    (tmp_path / "discs.yaml").write_text(DISCS)
    return tmp_path


def test_detect_writes_points_pictures_and_reasons(command, folder) -> None:
    ended = command("detect", "images", "--target", "discs.yaml", "--output", "found", "--overlay", "--workers", 1)
    assert ended.code == 0, ended.err
    assert "clutter.png: board not found" in ended.out
    assert "blurred.png: blurred by about " in ended.out
    assert "damaged.png: " in ended.out
    found = Observations.load(folder / "found" / "images.npz")
    assert found.image_names == ("board.png",) and len(found.pixels) == 77
    assert found.disc_radius == 0.004
    pictures = {path.name.split("_", 1)[1]: path for path in (folder / "found" / "images_overlay").iterdir()}
    assert sorted(pictures) == ["blurred.png", "board.png", "clutter.png"]
    board = cv2.imread(str(pictures["board.png"])).astype(int)
    green = (board[..., 1] > board[..., 0] + 60) & (board[..., 1] > board[..., 2] + 60)
    assert all(green[round(y), round(x)] for x, y in found.pixels)
    clutter = cv2.imread(str(pictures["clutter.png"])).astype(int)
    red = (clutter[..., 2] > clutter[..., 0] + 100) & (clutter[..., 2] > clutter[..., 1] + 100)
    assert red[:160, :900].sum() > 300  # the reason, at the top left
    assert red[200:].sum() > 300  # the candidates that were refused
    command("detect", "images", "--target", "discs.yaml", "--output", "found", "--workers", 1).refused(2, "--overwrite")


def test_detect_where_nothing_is_found(command, folder) -> None:
    for name in ("board.png", "damaged.png"):
        (folder / "images" / name).unlink()
    ended = command("detect", "images", "--target", "discs.yaml", "--output", "found", "--workers", 1)
    assert ended.code == 1
    assert not (folder / "found" / "images.npz").exists()


def test_detect_ends_as_calibrate_does_where_there_are_no_observations(command, folder) -> None:
    words = ("images", "--target", "discs.yaml", "--workers", 1, "--output", "found")
    cv2.imwrite(str(folder / "images" / "small.png"), np.zeros((480, 640), np.uint8))
    for told in ("differ in size", "none of 1 images can be read"):
        for name in ("detect", "calibrate"):
            ended = command(name, *words)
            assert ended.code == 2 and told in ended.err.splitlines()[-1], ended.err
            assert "--resume" not in ended.err and not list(folder.glob(".*"))  # which would end in the same way
        for path in folder.glob("images/[!d]*.png"):
            path.unlink()


def test_detect_writes_the_cameras_that_saw_the_target_and_fails_for_the_others(command, tmp_path) -> None:
    camera, target = paper_camera(), paper_target()
    for name in ("seen", "blind"):
        (tmp_path / "rig" / name).mkdir(parents=True)
    picture = render(camera, target, look_pose(target, 0.9, 0.4, 0.12, tilt=0.4), Imaging(blur=0.8, noise=2))
    cv2.imwrite(str(tmp_path / "rig" / "seen" / "1.png"), picture)
    cv2.imwrite(str(tmp_path / "rig" / "blind" / "1.png"), np.full_like(picture, 100))
    (tmp_path / "discs.yaml").write_text(DISCS)
    words = ("--topic", "seen", "--topic", "blind", "--target", "discs.yaml", "--workers", 1)
    ended = command("detect", "rig", *words, "--output", "found")
    assert ended.code == 1 and "blind: error: " in ended.err, ended.err
    assert [path.name for path in (tmp_path / "found").iterdir()] == ["seen.npz"]


def test_detect_replaces_no_overlay_silently(command, folder) -> None:
    overlay = folder / "found" / "images_overlay"
    overlay.mkdir(parents=True)
    words = ("detect", "images", "--target", "discs.yaml", "--output", "found", "--overlay", "--workers", 1)
    command(*words).refused(2, "images_overlay is there already", "--overwrite")
    assert command(*words, "--overwrite").code == 0 and list(overlay.iterdir())


def test_overlays_are_called_as_images_of_a_bag_by_the_whole_of_their_time(command, recording, tmp_path) -> None:
    words = ("--topic", "/left/image_raw", "--target", recording / "board.yaml", "--workers", 1, "--overlay")
    assert command("detect", recording / "rig.mcap", *words, "--output", "found").code == 0
    names = sorted(path.stem for path in (tmp_path / "found" / "left_overlay").iterdir())
    assert names[:2] == ["000000_1000000000.000000000", "000001_1000000000.500000000"]


def test_detect_refuses_points(command, observation_file, folder) -> None:
    command("detect", observation_file, "--target", "discs.yaml", "--output", "found").refused(2, "needs images")


@pytest.mark.parametrize("kind", ["pdf", "svg", "png"])
def test_target_writes_a_page(command, folder, kind) -> None:
    ended = command("target", "discs.yaml", "-o", f"discs.{kind}", "--page", "letter")
    assert ended.code == 0, ended.err
    assert f"discs.{kind}" in ended.out and "100 mm" in ended.out
    before = (folder / f"discs.{kind}").read_bytes()
    command("target", "discs.yaml", "-o", f"discs.{kind}").refused(2, "--overwrite")
    assert (folder / f"discs.{kind}").read_bytes() == before
    assert command("target", "discs.yaml", "-o", f"discs.{kind}", "--overwrite").code == 0


def test_a_printed_page_is_detected(command, folder) -> None:
    (folder / "page").mkdir()
    assert command("target", "discs.yaml", "-o", "page/discs.png").code == 0
    ended = command("detect", "page", "--target", "discs.yaml", "--output", "found", "--workers", 1)
    assert ended.code == 0 and "77 points in 1 views" in ended.out
    found = Observations.load(folder / "found" / "page.npz")
    first, second = (found.pixels[found.point_index == index][0] for index in (0, 1))
    assert np.hypot(*(second - first)) == pytest.approx(12 * 300 / 25.4, abs=0.05)


def test_target_refuses(command, folder) -> None:
    command("target", "absent.yaml", "-o", "a.pdf").refused(2, "absent.yaml")
    command("target", "discs.yaml", "-o", "a.doc").refused(2, ".pdf, .svg, .png")
    command("target", "discs.yaml", "-o", "a.pdf", "--page", "b7").refused(2, "b7")
    (folder / "wall.yaml").write_text(DISCS.replace("0.012", "0.12").replace("0.004", "0.04"))
    command("target", "wall.yaml", "-o", "a.pdf").refused(2, "does not fit on a4")
    assert not (folder / "a.pdf").exists()


def test_target_lists_the_shipped_ones_and_writes_one_to_edit(command, tmp_path) -> None:
    listed = command("target")
    assert listed.code == 0
    names = [line.split()[0] for line in listed.out.splitlines()]
    assert names == sorted(names) and "circle_grid_11x7" in names
    for kind in ("chessboard", "checkerboard", "circle_grid", "charuco", "aprilgrid"):
        written = command("target", "--new", kind)
        assert written.code == 0 and "#" in written.out
        (tmp_path / "board.yaml").write_text(written.out)
        assert command("target", "board.yaml").code == 0
    assert command("target", "circle_grid_11x7", "--output", "x.svg").code == 0
    command("target", "--new", "hexagons").refused(2, "--new hexagons: give a kind, circle_grid, chessboard")
    command("target", "--output", "y.svg").refused(2, "TARGET")
    command("target", "circle_grid_11x7", "--new", "chessboard").refused(2, "--new")
