"""The contracts themselves: registered parts with a fault fail by name, right ones pass, with no list to edit."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.timeout(900)  # whole cameras are calibrated with every foreign part

TESTS = Path(__file__).resolve().parents[1]
WRONG = (
    "wrong_sign",
    "wrong_off_axis",
    "wrong_column",
    "wrong_inverse",
    "wrong_mirrored",
    "wrong_permuted",
    "wrong_claim",
    ".wrong_box",
    "wrong_corner",
)


def failures(where: str, which: str) -> list[str]:
    """Tests that fail with the foreign entries registered, in a process of its own."""
    words = ["-p", "foreign_entries", "-p", "no:cacheprovider", "-q", "--tb=no", "-rfE", "-m", "not slow and not live"]
    words += [f"--ignore={__file__}", f"--ignore={Path(__file__).with_name('test_doors.py')}"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words, "-k", which, str(TESTS / where)],
        env={**os.environ, "PYTHONPATH": str(TESTS / "support"), "PYTEST_ADDOPTS": ""},
        cwd=TESTS.parent,
        capture_output=True,
        text=True,
        timeout=800,
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) > 50
    return re.findall(r"^(?:FAILED|ERROR) (\S.*?)(?: - .*)?$", done.stdout, re.MULTILINE)


@pytest.fixture(scope="module")
def failed() -> list[str]:
    return failures("contracts", "(right_ or wrong_) and not auto")


@pytest.mark.parametrize("name", WRONG)
def test_a_part_with_a_fault_fails_by_name(failed, name) -> None:
    assert [test for test in failed if re.search(rf"[\['\-]{re.escape(name)}[\]'\-]", test)]


def test_right_parts_from_outside_pass(failed) -> None:
    assert [test for test in failed if "wrong_" not in test] == []


def test_cameras_too_fail_with_a_wrong_pupil_and_pass_with_a_right_one() -> None:
    failed = failures("camera/test_jacobians.py", "(wrong_sign or right_cosine) and not right_prism")
    assert [test for test in failed if "wrong_sign" in test]
    assert [test for test in failed if "wrong_" not in test] == []
