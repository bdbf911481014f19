"""Names from outside drive neither a terminal nor a spreadsheet, whichever way they come and go."""

from __future__ import annotations

import csv
import io
import json
import sys

import numpy as np
import pytest
from bag_writers import images, messages, write_db3, write_folder, write_mcap, write_ros1

from fisheye_ep_calib.commands.fleet_table import as_csv, failed_row
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import one_line, plain_streams, printable, shown
from fisheye_ep_calib.report.html import render
from fisheye_ep_calib.storage.json_text import json_text, readable_json
from fisheye_ep_calib.storage.recording import open_recording

EVIL = "/a\x1b]0;owned\x07\x1b[31m\nfisheye_ep_calib: all is well\r\u202eb/image_raw"
BOARD = "type: chessboard\ncolumns: 9\nrows: 6\nspacing: 0.02\n"


@pytest.mark.parametrize("write", [write_mcap, write_db3, write_ros1])
def test_topics_of_bags(command, tmp_path, write) -> None:
    (tmp_path / "board.yaml").write_text(BOARD)
    path = write(tmp_path / f"a{ {write_mcap: '.mcap', write_db3: '.db3', write_ros1: '.bag'}[write]}",
                 messages(images(3), EVIL) + messages(images(3), "/b/image_raw"))  # fmt: skip
    with open_recording(path) as recording:
        name = next(topic.name for topic in recording.image_topics() if "owned" in topic.name)
        assert name.isprintable() and recording.frame(name, 1).image().shape == (60, 80)
    ended = command("detect", path, "--target", "board.yaml", "--output", "out", "--workers", 1)
    assert "owned" in ended.err and ended.code in (1, 2)
    assert_plain(ended.out + ended.err)


def test_names_of_files_and_folders(command, tmp_path) -> None:
    (tmp_path / "board.yaml").write_text(BOARD)
    folder = write_folder(tmp_path / "front\x1b[2J\x07", images(2), name="img\x1b[31m\n{}")
    ended = command("detect", folder, "--target", "board.yaml", "--output", "out", "--workers", 1)
    assert_plain(ended.out + ended.err)
    ended = command("show", "no\x1b[2J\nerror: none.yaml")
    assert_plain(ended.err)
    assert len(ended.err.splitlines()) == 1


def assert_plain(text: str) -> None:
    assert all(character.isprintable() or character in "\n\t" for character in text.replace("\r", "", 1)), repr(text)
    assert not any(line.startswith("fisheye_ep_calib: all is well") for line in text.splitlines())


def test_streams_escape_what_commands_print(monkeypatch) -> None:
    text = io.StringIO()
    monkeypatch.setattr(sys, "stdout", text)
    with plain_streams():
        print("a\x1b[31m\tθ\nb\u202e\u0085")
        print("\rbar", end="", flush=True)
    assert text.getvalue() == "a\\x1b[31m\tθ\nb\\u202e\\x85\n\rbar" and sys.stdout is text


def test_values_that_errors_repeat_are_short() -> None:
    nest: list = []
    for _ in range(1000):
        nest = [nest]
    for value in ("x" * 10**6, ["x" * 10**6] * 10**4, {n: n for n in range(10**5)}, nest, np.zeros(10**6), "\x1b\n"):
        assert len(shown(value)) < 1000 and shown(value).isprintable()
    assert len(one_line("x" * 10**6)) < 5000 and printable("\x1b\r") == "\\x1b\\r"


HOSTILE_NAMES = [
    *("=cmd|' /C calc'!A0", "+1", "-1", "@x", "\uff1d1+1", " =1", "\t=1", "\r=1", 'a"b,c\nd', "a;=1;b"),
    *("\x1b[31m\x00\x07\x7f\x85", "\u202eevil\u2066", "\udcff", "\U000e0001"),
]


@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_cells_of_the_fleets_table_are_text(name) -> None:
    text = as_csv([{**failed_row(name, name), "fx": -1.5}])
    header, row = csv.reader(io.StringIO(text))
    assert text.isprintable() or all(character.isprintable() or character == "\n" for character in text)
    cells = dict(zip(header, row, strict=True))
    assert cells["device"] == cells["reason"] and float(cells["fx"]) == -1.5
    assert cells["device"].lstrip()[0] not in "=+-@\uff1d" and one_line(name) in cells["device"]
    divided = list(csv.reader(io.StringIO(text.replace(",", ";")), delimiter=";"))
    assert not any(cell.startswith("=") for line in divided for cell in line)


@pytest.mark.parametrize("name", HOSTILE_NAMES)
@pytest.mark.parametrize("form", [json_text, readable_json])
def test_json_escapes_what_cannot_be_seen_and_says_the_same(form, name) -> None:
    text = form({name: [name, "θ µ"]})
    assert printable(text) == text and json.loads(text) == {name: [name, "θ µ"]}


def test_a_page_shows_names_plainly(monkeypatch) -> None:
    monkeypatch.setattr("fisheye_ep_calib.report.html._FILES", ("page.css", "page.js", "page.html"), raising=True)
    from jinja2 import DictLoader

    monkeypatch.setattr(
        "fisheye_ep_calib.report.html.DictLoader", lambda texts: DictLoader({**texts, "page.html": "<p>{{ name }}</p>"})
    )
    assert render("page.html", name="<b>\x1b[31m\u202e") == "<p>&lt;b&gt;\\x1b[31m\\u202e</p>"


def test_an_input_error_is_one_line_however_it_is_made(command, tmp_path) -> None:
    (tmp_path / "t.yaml").write_text('type: "a\\n\\e[31m"\n')
    ended = command("target", "t.yaml", "--output", "x.pdf")
    assert ended.code == InputError.exit_code and len(ended.err.splitlines()) == 1
    assert_plain(ended.err)


def test_a_number_keeps_its_unit() -> None:
    from fisheye_ep_calib.plain_text import one_line, printable

    assert one_line("0.12\u00a0m") == printable("0.12\u00a0m\n").strip("\n") == "0.12\u00a0m"
