"""Images that a recording holds twice, because the same bag was given under two names: they would count double."""

from __future__ import annotations

from collections.abc import Sequence

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.sources.base import BagSource, Entry

_COMPARED = 3  # messages of equal time that are read: time alone does not make them the same


def without_copies(bags: Sequence[BagSource]) -> list[str]:
    """Take images out that an earlier one of the bags holds too; what was taken out, in words."""
    remarks = []
    for number, later in enumerate(bags):
        for topic, entries in later.entries.items():
            for earlier in bags[:number]:
                stamps = {entry.stamp_ns: entry for entry in earlier.entries.get(topic, ())}
                shared = [(stamps[entry.stamp_ns], entry) for entry in entries if entry.stamp_ns in stamps]
                if shared and _are_copies(earlier, later, topic, shared):
                    entries[:] = [entry for entry in entries if entry.stamp_ns not in stamps]
                    remarks.append(
                        f"{later.path}: {len(shared)} images of {topic} are those of {earlier.path}; used once"
                    )
    return remarks


def _are_copies(earlier: BagSource, later: BagSource, topic: str, pairs: list[tuple[Entry, Entry]]) -> bool:
    chosen = pairs[:: max(1, (len(pairs) - 1) // (_COMPARED - 1))]
    try:
        return all(
            earlier.read(topic, first) == later.read(topic, second)
            and earlier.encodings[topic] == later.encodings[topic]
            for first, second in chosen
        )
    except (InputError, OSError):
        return False
