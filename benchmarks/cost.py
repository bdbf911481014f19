"""What a whole calibration costs against another version of this package, as ratios of processor time.

    git worktree add /tmp/before COMMIT
    OMP_NUM_THREADS=1 python benchmarks/cost.py --against /tmp/before [--data OBSERVATIONS.npz ...] [--repeats 3]

``calibrate(observations)`` with everything left to "auto", and the command ``calibrate OBSERVATIONS --no-report`` with
all that it looks at, each in a process of its own, this version and the other one by turns; the least of the repeats.
Beside the files given: simulated views of 77 points, by which the cost's growth with the number of views is told.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from monte_carlo import markdown
from speed import scene

LIMIT = 3.0
HERE = Path(__file__).resolve().parents[1]
CALL = """
import sys, time
import scipy.linalg, scipy.spatial
from fisheye_ep_calib import Observations, calibrate
observations = Observations.load(sys.argv[1])
began = time.process_time()
calibrate(observations)
print(time.process_time() - began)
"""


def written(views: int, folder: Path) -> Path:
    """An observation file of simulated views."""
    seen = scene(views)
    path = folder / f"{views} views.npz"
    np.savez(
        path,
        object_points=1e3 * seen.object_points,
        unit="mm",
        image_index=seen.image_index,
        point_index=seen.point_index,
        pixels=seen.pixels,
        image_size=seen.image_size,
    )
    return path


def seconds(package: Path, arguments: Sequence[str | Path]) -> tuple[float, str]:
    """Processor time of a Python process that imports the package from a folder, and what it printed."""
    environment = os.environ | {"PYTHONPATH": str(package), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as elsewhere:
        done = subprocess.run(
            [sys.executable, *arguments], env=environment, cwd=elsewhere, check=True, capture_output=True, text=True
        )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def of_call(package: Path, path: Path) -> float:
    return float(seconds(package, ["-c", CALL, path])[1])


def of_command(package: Path, path: Path) -> float:
    command = ["-m", "fisheye_ep_calib", "calibrate", path, "--output", "result", "--no-report"]
    return seconds(package, command)[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, required=True, help="folder with the other version")
    parser.add_argument("--data", type=Path, nargs="*", default=[], help="observation files")
    parser.add_argument("--views", type=int, nargs="*", default=[25, 1000])
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    rows, good = [], True
    with tempfile.TemporaryDirectory() as folder:
        paths = [written(views, Path(folder)) for views in arguments.views] + [
            path.resolve() for path in arguments.data
        ]
        for path in paths:
            for name, measure in (("calibrate()", of_call), ("command", of_command)):
                taken = [
                    [measure(package, path) for package in (arguments.against.resolve(), HERE)]
                    for _ in range(arguments.repeats)
                ]
                before, now = np.min(taken, axis=0)
                good &= now <= LIMIT * before
                rows.append((path.stem, name, f"{before:.2f}", f"{now:.2f}", f"{now / before:.2f}"))
                print(*rows[-1], flush=True)
    print(markdown(("observations", "", "the other, s", "this, s", "ratio"), rows))
    print(f"{'within' if good else 'OUTSIDE'} the limit of {LIMIT:g}")
    raise SystemExit(0 if good else 1)


if __name__ == "__main__":
    main()
