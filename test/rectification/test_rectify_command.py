"""fisheye_ep_calib rectify, as it is typed."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from fisheye_ep_calib.cli import main
from fisheye_ep_calib.rectification import Rectifier, make_view
from fisheye_ep_calib.simulation import Imaging, StampedImage, paper_poses, render, write_bag
from fisheye_ep_calib.storage.camera_file import read_camera_file, save_camera
from fisheye_ep_calib.target.boards.chessboard import Chessboard


@pytest.fixture(scope="module")
def camera_file(calibrated, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("camera") / "front.yaml"
    save_camera(path, calibrated, "front")
    return path


@pytest.fixture(scope="module")
def image(lens) -> np.ndarray:
    board = Chessboard.create("board", 11, 7, spacing=0.012)
    grey = render(lens, board, paper_poses(board)[2], Imaging(texture=40))
    return cv2.merge([grey, grey, 255 - grey])


@pytest.fixture
def folder(image, tmp_path) -> Path:
    folder = tmp_path / "images"
    folder.mkdir()
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / name), image)
    return folder


SMALL = ("--size", "200x150", "--interpolation", "linear")


def test_a_folder_in_colour(camera_file, folder, image, tmp_path, capsys) -> None:
    output = tmp_path / "out"
    arguments = ["rectify", str(camera_file), str(folder), "--distance", "0.12", "--output", str(output), *SMALL]
    assert main(arguments) == 0
    assert "wrote 2 images, 200×150" in capsys.readouterr().out
    assert sorted(path.name for path in output.iterdir()) == ["a.png", "b.png", "camera_info.yaml"]
    camera = read_camera_file(camera_file).camera
    view = make_view(camera, size=(200, 150))
    expected = Rectifier(camera, view).rectify(image, 0.12)
    assert (cv2.imread(str(output / "a.png")) == expected).all()
    content = yaml.safe_load((output / "camera_info.yaml").read_text())
    assert content["camera_matrix"]["data"][0] == pytest.approx(view.focal)
    assert content["distortion_model"] == "plumb_bob" and content["view"]["distance"] == 0.12

    assert main(arguments) == 2
    assert "a.png is there already" in capsys.readouterr().err
    assert main([*arguments, "--overwrite", "--svp"]) == 0
    without_pupil = cv2.imread(str(output / "a.png"))
    stand_in = read_camera_file(camera_file).stand_in
    assert (without_pupil == Rectifier(stand_in, make_view(stand_in, size=(200, 150))).rectify(image, 0.12)).all()


@pytest.mark.parametrize("projection", ["cylindrical", "equirectangular"])
def test_a_bag(camera_file, image, tmp_path, projection) -> None:
    bag, output = tmp_path / "bag.mcap", tmp_path / "out"
    grey = np.ascontiguousarray(image[..., 0])
    write_bag(bag, [StampedImage("/front/image_raw", 10**9 + i, "front", grey) for i in range(3)])
    arguments = ["--projection", projection, "--fov", "180", "--every", "2", "--output", str(output), *SMALL]
    assert main(["rectify", str(camera_file), str(bag), *arguments]) == 0
    names = sorted(path.name for path in output.glob("*.png"))
    assert names == ["1.000000000.png", "1.000000002.png"]
    assert cv2.imread(str(output / names[0]), cv2.IMREAD_UNCHANGED).shape == (150, 200)


def test_damaged_images_are_told_and_passed_over(camera_file, folder, tmp_path, capsys) -> None:
    (folder / "b.png").write_bytes(b"not an image")
    cv2.imwrite(str(folder / "c.png"), np.zeros((10, 10), np.uint8))
    arguments = ["rectify", str(camera_file), str(folder), "--output", str(tmp_path / "out"), *SMALL]
    assert main(arguments) == 0
    captured = capsys.readouterr()
    assert "wrote 1 image," in captured.out
    assert "b.png: " in captured.err and "c.png: the image is 10×10, the camera 2048×2048" in captured.err
    before = {path: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert main([*arguments, "--overwrite", "--strict"]) == 2
    assert {path: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before
    (folder / "a.png").unlink()
    assert main([*arguments, "--overwrite"]) == 2
    assert "none of 2 images could be rectified" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--distance", "0"], "--distance must be positive"),
        (["--distance", "nan"], "--distance must be positive"),
        (["--every", "0"], "--every"),
        (["--fov", "200"], "up to 170°"),
        (["--size", "0x10"], "each side"),
        (["--topic", "/nowhere"], "there is no topic /nowhere"),
    ],
)
def test_wrong_arguments(camera_file, folder, tmp_path, capsys, arguments, complaint) -> None:
    output = tmp_path / "out"
    assert main(["rectify", str(camera_file), str(folder), "--output", str(output), *arguments]) == 2
    assert complaint in capsys.readouterr().err
    assert not output.exists()
