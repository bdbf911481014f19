"""Runs changed inputs through the doors for a while: python test/fuzz/run.py MINUTES [SEED]. See docs/results.md.

Failing inputs are kept in .fuzz/, named by what does not hold. Exit code 1 where there are any.
"""

from __future__ import annotations

import hashlib
import importlib
import pkgutil
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
_ROUND = 50  # inputs drawn from one seed


class Record:
    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.codes: Counter[int] = Counter()
        self.failed: list[str] = []
        self.seconds = self.megabytes = 0.0
        self._seen: set[bytes] = set()

    def is_new(self, content: bytes, door: list[str]) -> bool:
        """Whether this content has not been at this door: hypothesis draws some again."""
        digest = hashlib.sha256(repr(door).encode() + content).digest()
        new = digest not in self._seen
        self._seen.add(digest)
        return new

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


def search(record: Record, number: int, until: float) -> None:
    """One round: inputs drawn by hypothesis from one seed, no more after a time of the monotonic clock."""

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
        if time.monotonic() < until and record.is_new(content, door):
            record.note(path.name, content, door, judged(path.name, content, door))

    one()


def preload() -> None:
    """What the commands import, once: each input has a process of its own, forked from this one."""
    import calib_targets  # noqa: F401
    import cv2
    import rosbags.serde.primitives  # noqa: F401
    import rosbags.typesys.stores.ros2_jazzy  # noqa: F401
    import scipy.sparse.linalg  # noqa: F401
    import scipy.stats  # noqa: F401
    import tqdm  # noqa: F401

    import fisheye_ep_calib

    for module in pkgutil.walk_packages(fisheye_ep_calib.__path__, "fisheye_ep_calib."):
        if not module.name.startswith(("fisheye_ep_calib.ros", "fisheye_ep_calib.web", "fisheye_ep_calib.__main__")):
            importlib.import_module(module.name)
    cv2.setNumThreads(1)


def main() -> int:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    number = int(sys.argv[2]) if len(sys.argv) > 2 else int(time.time())
    preload()
    resource.setrlimit(resource.RLIMIT_DATA, (3 << 30, 3 << 30))  # of the harness too
    record, began = Record(), time.monotonic()
    until = began + 60 * minutes
    while time.monotonic() < until:
        search(record, number, until)
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
