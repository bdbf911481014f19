"""Runs changed inputs through the doors for a while: python test/fuzz/run.py MINUTES [SEED]. See docs/results.md.

Failing inputs are kept in .fuzz/, named by what does not hold. Exit code 1 where there are any.
"""

from __future__ import annotations

import hashlib
import resource
import sys
import time
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as with_seed
from hypothesis import strategies as st
from judging import SEEDS, Verdict, doors, judged
from mutations import mutated

KEPT = Path(".fuzz")
_ROUND = 25  # inputs between two looks at the clock


class Record:
    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.codes: Counter[int] = Counter()
        self.failed: list[str] = []
        self.seconds = self.megabytes = 0.0

    def note(self, name: str, content: bytes, door: list[str], verdict: Verdict) -> None:
        self.counts[name] += 1
        self.codes[verdict.code] += 1
        self.seconds, self.megabytes = max(self.seconds, verdict.seconds), max(self.megabytes, verdict.megabytes)
        if not verdict.faults:
            return
        KEPT.mkdir(exist_ok=True)
        stem = KEPT / hashlib.sha256(content).hexdigest()[:12]
        Path(f"{stem}_{name}").write_bytes(content)
        line = f"{stem}_{name}: {' '.join(door)}: {'; '.join(verdict.faults)}"
        Path(f"{stem}_{name}.txt").write_text(f"{line}\n{verdict.said[-4000:]}")
        self.failed.append(line)
        print(line, flush=True)


def search(record: Record, number: int) -> None:
    """One round: inputs drawn by hypothesis from one seed."""

    @with_seed(number)
    @settings(
        max_examples=_ROUND,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def one(data: st.DataObject) -> None:
        path = data.draw(st.sampled_from(sorted(path for path in SEEDS.iterdir() if path.is_file())))
        door = data.draw(st.sampled_from(doors(path.name)))
        content = mutated(path, data.draw)
        record.note(path.name, content, door, judged(path.name, content, door))

    one()


def preload() -> None:
    """What the commands import, once: each input has a process of its own, forked from this one."""
    import cv2

    import fisheye_ep_calib.commands.calibrate
    import fisheye_ep_calib.commands.detect
    import fisheye_ep_calib.commands.evaluate
    import fisheye_ep_calib.storage.sources.bag_file
    import fisheye_ep_calib.storage.sources.db3_file
    import fisheye_ep_calib.storage.sources.mcap_file  # noqa: F401

    cv2.setNumThreads(1)


def main() -> int:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    number = int(sys.argv[2]) if len(sys.argv) > 2 else int(time.time())
    preload()
    resource.setrlimit(resource.RLIMIT_DATA, (3 << 30, 3 << 30))  # of the harness too
    record, began = Record(), time.monotonic()
    until = began + 60 * minutes
    while time.monotonic() < until:
        search(record, number)
        number += 1
        print(f"{sum(record.counts.values())} inputs, {len(record.failed)} failing, {record.seconds:.1f} s, "
              f"{record.megabytes:.0f} MB at most", flush=True)  # fmt: skip
    print(f"{(time.monotonic() - began) / 60:.0f} min, {sum(record.counts.values())} inputs: "
          f"{dict(sorted(record.codes.items()))} by exit code, {len(record.failed)} failing; "
          f"longest {record.seconds:.1f} s, most memory {record.megabytes:.0f} MB")  # fmt: skip
    print(dict(sorted(record.counts.items())))
    return bool(record.failed)


if __name__ == "__main__":
    sys.exit(main())
