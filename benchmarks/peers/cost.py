"""Processor time of a fit beside others at 25, 200 and 1,000 views: `make benchmark`, or

    python benchmarks/peers/cost.py [--views 25 200 1000] [--peers NAME ...] [--limit 120]

All get the views of ../speed.py, within 80° of the axis, where cv2.fisheye works, and a good focal length; each fit
runs in a process of its own with one thread. Times are ratios to cv2.fisheye's. What takes longer than the limit, in
seconds of processor time, is ended and said to take more.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.append(str(Path(__file__).resolve().parents[1]))

import cv2
from fits import PEERS
from speed import scene

from fisheye_ep_calib import Observations

REFERENCE = "OpenCV fisheye"
FOCAL = 592.0  # pixels, of the scene's camera


def measured(name: str, observations: Observations, limit: int) -> float | str:
    """Processor seconds of one fit, or what became of it."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=fit, args=(theirs, name, observations, limit))
    process.start()
    theirs.close()
    try:
        return ours.recv()
    except EOFError:  # the kernel ended it
        return f"more than {limit} s"
    finally:
        process.join()


def fit(answer: Connection, name: str, observations: Observations, limit: int) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    cv2.setNumThreads(1)
    PEERS[name](scene(6), FOCAL)  # imports and the first call are not what is measured
    began = time.process_time()
    try:
        PEERS[name](observations, FOCAL)
        answer.send(time.process_time() - began)
    except ImportError as error:
        answer.send(f"not installed: {error.name}")
    except Exception as error:  # noqa: BLE001 - a peer may fail in any way, and that is a result
        answer.send(f"fails: {str(error).strip().splitlines()[-1][:60]}")


def cell(found: float | str, reference: float | str) -> str:
    if isinstance(found, str):
        return found
    seconds = f"{found:.2f} s"
    return seconds if isinstance(reference, str) else f"{found / reference:.3g} ({seconds})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, nargs="*", default=[25, 200, 1000])
    parser.add_argument("--peers", nargs="*", default=list(PEERS), help=", ".join(PEERS))
    parser.add_argument("--limit", type=int, default=120, help="seconds of processor time a fit")
    arguments = parser.parse_args()
    names = list(dict.fromkeys([REFERENCE, *arguments.peers]))
    found: dict[str, list[str]] = {name: [] for name in names}
    for views in arguments.views:
        observations = scene(views)
        reference = measured(REFERENCE, observations, arguments.limit)
        for name in names:
            seconds = reference if name == REFERENCE else measured(name, observations, arguments.limit)
            found[name].append(cell(seconds, reference))
            print(f"{views} views, {name}: {found[name][-1]}", file=sys.stderr, flush=True)
    head = ["", *(f"{views} views" for views in arguments.views)]
    print(f"### Processor time, of {REFERENCE}'s\n\n| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for name in names:
        print(f"| {name} | {' | '.join(found[name])} |")


if __name__ == "__main__":
    main()
