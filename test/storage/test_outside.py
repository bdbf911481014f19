"""Files from outside: regular ones alone, bounded while they are read, one line for what cannot be read."""

from __future__ import annotations

import ast
import os
import socket
from pathlib import Path

import pytest

import fisheye_ep_calib
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import (
    checked_path,
    expanded,
    open_outside,
    other_than_a_file,
    read_outside,
    read_text_outside,
    real_path,
)

PACKAGE = Path(fisheye_ep_calib.__file__).parent
# Opens what this package itself has made, or asked its user's machine for: worker files, logs, demos, templates.
OWN_FILES = {
    "outside.py",
    "cli.py",  # /dev/null
    "collection/workers.py",
    "collection/detection_log.py",
    "commands/fleet_jobs.py",
    "commands/live_demo.py",  # the log of its node
    "report/html.py",
    "storage/atomic.py",
    "storage/compression.py",
    "storage/held.py",
    "storage/quiet_libraries.py",  # /dev/null
    "storage/sources/image_archive.py",
}
BARE = {
    "open",
    "read_text",
    "read_bytes",
    "load",
    "safe_load",
    "unsafe_load",
    "full_load",
    "imread",
    "fromfile",
    "loadtxt",
}
BARE_OF = {"json", "yaml", "np", "numpy", "pickle", "os", "io", "cv2"}  # modules whose own calls these are


def test_a_pipe_a_device_a_socket_and_a_folder_are_refused_at_once(tmp_path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(os.fspath(tmp_path / "socket"))
        for place in (tmp_path / "pipe", tmp_path / "socket", tmp_path, Path("/dev/zero"), tmp_path / "no\0name"):
            with pytest.raises(InputError, match="cannot read target file") as refused:
                read_outside(place, 100, "target")
            assert str(refused.value).isprintable()


def test_size_is_what_is_read_not_what_is_said(tmp_path) -> None:
    with pytest.raises(InputError, match="too large"):
        read_outside("/proc/kallsyms" if Path("/proc/kallsyms").exists() else __file__, 10)
    assert read_outside("/proc/self/status", 1 << 16).startswith(b"Name:")  # a file that says it has 0 bytes
    (tmp_path / "exact").write_bytes(b"x" * 10)
    assert read_outside(tmp_path / "exact", 10) == b"x" * 10
    with pytest.raises(InputError, match="at most 9 bytes"):
        read_outside(tmp_path / "exact", 9)


def test_text_is_utf_8_and_links_to_files_are_followed(tmp_path) -> None:
    (tmp_path / "text").write_bytes("\ufeffµ".encode())
    (tmp_path / "link").symlink_to("text")
    assert read_text_outside(tmp_path / "link", 100) == "µ"
    (tmp_path / "latin").write_bytes(b"\xb5")
    with pytest.raises(InputError, match="no text in UTF-8"):
        read_text_outside(tmp_path / "latin", 100)
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(InputError, match="cannot read"):
        open_outside(tmp_path / "loop")


@pytest.mark.parametrize("module", sorted(PACKAGE.rglob("*.py")), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_nothing_else_opens_files(module) -> None:
    """What a user names goes through ``outside``; the others open what the package itself has made."""
    if module.relative_to(PACKAGE).as_posix() in OWN_FILES:
        return
    assert bare_openings(ast.parse(module.read_text("utf-8"))) == []


def bare_openings(tree: ast.AST) -> list[str]:
    """Calls of builtin open, of ``Path.read_text`` and the like, and of modules' own loaders, with their lines."""
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        if isinstance(function, ast.Name) and function.id == "open":
            found.append(f"line {node.lineno}: open")
        if isinstance(function, ast.Attribute) and function.attr in BARE:
            owner = function.value.id if isinstance(function.value, ast.Name) else ""
            if function.attr in ("read_text", "read_bytes") or owner in BARE_OF:
                found.append(f"line {node.lineno}: {owner}.{function.attr}")
    return found


def test_the_rule_sees_what_it_forbids() -> None:
    for line in ("open(p)", "p.read_text()", "Path(p).read_bytes()", "np.load(p)", "yaml.safe_load(t)", "json.load(f)"):
        assert bare_openings(ast.parse(line)), line
    for line in ("source.open(p)", "json.loads(t)", "tarfile.open(fileobj=f)", "Observations.load(p)"):
        assert not bare_openings(ast.parse(line)), line


def test_what_is_no_file_is_told_from_what_is_not_there(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("text")
    (tmp_path / "to_pipe").symlink_to(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    told = {name: other_than_a_file(tmp_path / name) for name in ("pipe", "to_pipe", "file", "loop", "none")}
    assert told == {"pipe": "a pipe", "to_pipe": "a pipe", "file": "", "loop": "", "none": ""}
    assert other_than_a_file(tmp_path) == "a folder" and other_than_a_file(os.devnull) == "a device"


def test_paths_that_lead_nowhere_are_left_as_they_are(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    assert real_path(tmp_path / "loop") == tmp_path.resolve() / "loop"
    assert expanded("~nobody_is_called_so/board.yaml") == Path("~nobody_is_called_so/board.yaml")
    assert expanded("~/board.yaml") == Path.home() / "board.yaml"


@pytest.mark.parametrize("path", ["", "a\0b", b"bytes", None, 5])
def test_what_no_file_can_be_called_is_no_path(path):
    with pytest.raises(InputError, match="`path` must be the path of a file"):
        checked_path(path, "path")


@pytest.mark.parametrize("method", ["resolve", "expanduser"])
def test_no_path_is_followed_by_what_fails_on_a_loop_or_an_unknown_user(method):
    """Path.resolve() ends in RuntimeError on a link to itself, Path.expanduser() on a user that there is not."""
    calls = [
        f"{file.relative_to(PACKAGE)}:{node.lineno}"
        for file in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute)
        and node.attr == method
        and ast.unparse(node) not in ("os.path.expanduser", "Path(__file__).resolve")
    ]
    assert not calls
