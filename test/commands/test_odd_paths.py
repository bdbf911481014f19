"""Paths that lead in a circle, to nobody's home, or to what is no file: refused in one line, and left as they are."""

from __future__ import annotations

import os
import stat

BOARD = "type: chessboard\ncolumns: 9\nrows: 6\nspacing: 0.02\n"


def test_links_to_themselves_and_users_that_are_not_there(command, tmp_path) -> None:
    (tmp_path / "board.yaml").write_text(BOARD)
    for name in ("loop.mcap", "loop.yaml", "fleet"):
        (tmp_path / name).symlink_to(tmp_path / name)
    (tmp_path / "devices").mkdir()
    (tmp_path / "devices" / "loop.mcap").symlink_to(tmp_path / "loop.mcap")
    looked = ("--target", "board.yaml", "--output", "out")
    command("calibrate", "loop.mcap", *looked).refused(2, "loop.mcap: Too many levels")
    command("detect", "loop.mcap", *looked).refused(2, "loop.mcap: Too many levels")
    command("detect", "loop.mcap", "--target", "~nobody_is_called_so/b.yaml", "--output", "out").refused(2)
    command("target", "~nobody_is_called_so/board.yaml", "--output", "a.pdf").refused(
        2, "~nobody_is_called_so/board.yaml"
    )
    ended = command("calibrate-fleet", "devices", *looked)
    assert ended.code in (1, 2) and "Traceback" not in ended.err
    ended = command("calibrate-fleet", "devices", "--target", "board.yaml", "--output", "fleet")
    assert ended.code in (1, 2) and "Traceback" not in ended.err


def test_what_is_no_file_is_not_written_over(command, observation_file, tmp_path) -> None:
    """Whoever may rename in /dev would lose /dev/null by it."""
    os.mkfifo(tmp_path / "pipe.pdf")
    (tmp_path / "link.pdf").symlink_to(tmp_path / "pipe.pdf")
    (tmp_path / "folder.pdf").mkdir()
    words = ("target", "circle_grid_11x7", "--overwrite", "--output")
    command(*words, "pipe.pdf").refused(2, "pipe.pdf is a pipe, not a file")
    command(*words, "link.pdf").refused(2, "link.pdf is a pipe, not a file")
    command(*words, "folder.pdf").refused(1, "folder.pdf: it is a folder, not a file")
    assert stat.S_ISFIFO((tmp_path / "pipe.pdf").lstat().st_mode) and (tmp_path / "link.pdf").is_symlink()
    (tmp_path / "out" / "calibration.json").mkdir(parents=True)
    words = ("calibrate", observation_file, "--output", "out", "--overwrite", "--no-report", "--model", "kannala")
    ended = command(*words)
    assert ended.code == 1 and "calibration.json: it is a folder, not a file" in ended.err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["calibration.json"]
