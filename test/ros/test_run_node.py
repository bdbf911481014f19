"""A node ends well whatever it is doing."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.live

BUSY_NODE = Path(__file__).with_name("busy_node.py")


@pytest.mark.parametrize("times", [2, pytest.param(100, marks=pytest.mark.slow)])
def test_a_signal_while_callbacks_run(start, times: int) -> None:
    for number in [signal.SIGINT, signal.SIGTERM] * (times // 2):
        node = start(sys.executable, str(BUSY_NODE), str(int(number)))
        assert node.process.wait(20) == 0, node.output
