"""Fixtures for every test."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

# Before NumPy is loaded: beside each other, two processes whose BLAS has two threads each spin for four times as long.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# A shell starts what it runs in the background with Ctrl-C ignored, which the programs of tests would inherit.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

from command_line import Ended  # noqa: E402

from fisheye_ep_calib.cli import main  # noqa: E402

NAME = "fisheye_ep_calib"
REPOSITORY = Path(__file__).resolve().parents[1]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """``colcon test``, which gives the package's name as prefix, runs what needs neither DDS nor long."""
    if config.getoption("junitprefix", None) != NAME:
        return
    left_out = [item for item in items if item.get_closest_marker("live") or item.get_closest_marker("slow")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real calibration data that is not part of the project; skips where it is absent."""
    folder = Path(os.environ.get("FISHEYE_EP_CALIB_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no calibration data at {folder}; set FISHEYE_EP_CALIB_DATA to the folder that has it")
    return folder


@pytest.fixture
def command(tmp_path, monkeypatch, capsys) -> Callable[..., Ended]:
    """Commands as a user calls them, in this process and an empty folder.

    An exception that is not turned into a line fails the test.
    """
    monkeypatch.chdir(tmp_path)

    def run(*words) -> Ended:
        capsys.readouterr()
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:  # argparse
            code = end.code
        printed = capsys.readouterr()
        return Ended(code, printed.out, printed.err)

    return run
