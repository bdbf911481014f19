"""Commands in this process, in an empty folder."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from command_line import Ended

from fisheye_ep_calib.cli import main


@pytest.fixture
def command(tmp_path, monkeypatch, capsys) -> Callable[..., Ended]:
    """An exception that is not turned into a line fails the test."""
    monkeypatch.chdir(tmp_path)

    def run(*words) -> Ended:
        capsys.readouterr()
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:  # argparse
            code = end.code
        said = capsys.readouterr()
        return Ended(code, said.out, said.err)

    return run
