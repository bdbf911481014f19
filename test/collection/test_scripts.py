"""Workers of a plain script, which spawned processes must not run again."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from bag_writers import write_folder
from numbered_target import picture

PLAIN = """
import sys
sys.path[:0] = {paths}
from numbered_target import TARGET
from fisheye_ep_calib import find_target

print("once")
found = find_target({folder!r}, TARGET, workers=2)
print(sum(observations.view_count for observations in found.values()))
"""

OWN_TARGET = """
import sys
sys.path[:0] = {paths}
from numbered_target import NumberedTarget, TARGET
from fisheye_ep_calib import find_target

class OwnTarget(NumberedTarget):
    pass

if __name__ == "__main__":
    print("once")
    found = find_target({folder!r}, OwnTarget("own", TARGET.object_points, None), workers=2)
    print(sum(observations.view_count for observations in found.values()))
"""


@pytest.mark.parametrize("content", [PLAIN, OWN_TARGET], ids=["without-a-guard", "with-a-target-of-its-own"])
def test_a_script_has_workers(tmp_path, content):
    folder = write_folder(tmp_path / "front", [picture(x=5 + 2 * number) for number in range(6)])
    here = Path(__file__).resolve().parent
    script = tmp_path / "script.py"
    paths = [str(here), str(here.parent / "support"), str(here.parents[1])]
    script.write_text(content.format(paths=paths, folder=str(folder)))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, env=environment)
    assert (done.returncode, done.stdout.split()) == (0, ["once", "6"]), done.stderr
