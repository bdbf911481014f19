"""What was found so far, on disk as it is found, so that an interrupted run goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import IO, Any

import numpy as np

from fisheye_ep_calib.collection.results import FrameResult
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.storage.held import open_own
from fisheye_ep_calib.storage.recording import Recording
from fisheye_ep_calib.storage.results_folder import make_folder, remove_empty
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.detection import Detection

if sys.platform != "win32":
    import fcntl
else:
    fcntl = None

FORMAT = 4
_NO_KIND = ("name", "object_points")  # of a target: what does not tell its kind, or not in few words


class DetectionLog:
    """One line of JSON an image. A line that a crash left unfinished is dropped.

    results: (topic, image) → what an earlier run saw in an image that is still the same; what it could not read may be
    readable by now. images: how many the log holds. holds_views: the target was found in some of them.
    """

    def __init__(self, path: Path, key: str, fingerprint: Callable[[str, int], str], resume: bool) -> None:
        """key: what was searched and for what; an earlier log of another key is not resumed (InputError).

        fingerprint: of an image, by topic and number, tells it from one that has taken its place.
        """
        self._fingerprint = fingerprint
        self.path = path
        self.results: dict[tuple[str, int], FrameResult] = {}
        self.images = 0
        self.holds_views = False
        try:
            self._made = make_folder(path.parent)
            self._file: IO[bytes] = open_own(path)
            self._lock()
            self._file.seek(0)
            self._take_over(self._file.read() if resume else b"", key)
        except OSError as error:
            raise CalibrationError(f"{path} cannot be used: {error.strerror or error}") from None

    def _lock(self) -> None:
        if fcntl is None:
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.close()
            raise InputError(f"{self.path} is in use by another run; give this one another `output`") from None
        except OSError:
            pass  # a file system without locks

    def _take_over(self, content: bytes, key: str) -> None:
        """Know what whole lines tell, and have new ones written after them."""
        lines = content.split(b"\n")[:-1]
        good = 0
        if lines:
            self._check(lines[0], key)
            results, whole = _parse(lines[1:])
            self.results = {
                image: result
                for image, (result, fingerprint) in results.items()
                if not result.error and fingerprint == self._fingerprint(*image)
            }
            good = sum(len(line) + 1 for line in lines[: 1 + whole])
            self.images = len(self.results)
            self.holds_views = any(result.is_view for result in self.results.values())
        self._file.truncate(good)
        if not good:
            self._write({"format": FORMAT, "key": key})

    def _check(self, line: bytes, key: str) -> None:
        try:
            head = json.loads(line)
            same = head["format"] == FORMAT and head["key"] == key
        except (ValueError, KeyError, TypeError):
            self._file.close()
            raise InputError(f"{self.path} is damaged; run without `resume`") from None
        if not same:
            self._file.close()
            raise InputError(f"{self.path} is of another recording or target; run without `resume`")

    def add(self, result: FrameResult) -> None:
        """Remember an image; on disk when this returns, short of a power cut."""
        try:
            self._write(_to_json(result) | {"fingerprint": self._fingerprint(result.topic, result.index)})
        except OSError as error:
            raise CalibrationError(f"cannot write {self.path}: {error.strerror or error}") from None
        self.images += 1
        self.holds_views |= result.is_view

    def _write(self, content: dict[str, Any]) -> None:
        self._file.write(json.dumps(content, separators=(",", ":")).encode() + b"\n")
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    def remove(self) -> None:
        """Delete and close: the results are saved elsewhere, or there are none."""
        self.path.unlink(missing_ok=True)
        self._file.close()
        remove_empty(self._made)


def search_key(recording: Recording, topics: Sequence[str], target: Target) -> str:
    """Names a search: the same images, by times or paths, for the same target, whatever its name."""
    digest = hashlib.sha256(type(target).__name__.encode())
    digest.update(np.ascontiguousarray(target.object_points, dtype="<f8").tobytes())
    kinds = [(field.name, getattr(target, field.name)) for field in fields(target) if field.name not in _NO_KIND]
    digest.update(repr(kinds).encode())
    for topic in sorted(topics):
        for part in (topic, *recording.identities(topic)):
            digest.update(os.fsencode(part) + b"\0")
    return digest.hexdigest()


def _to_json(result: FrameResult) -> dict[str, Any]:
    return {
        "topic": result.topic,
        "index": result.index,
        "stamp_ns": result.stamp_ns,
        "name": result.name,
        "image_size": result.image_size,
        "error": result.error,
        "reason": result.detection.reason,
        "point_index": result.detection.point_index.tolist(),
        "pixels": result.detection.pixels.tolist(),
        "rejected": result.detection.rejected.tolist(),
        "remark": result.detection.remark,
        "read_seconds": result.read_seconds,
        "detect_seconds": result.detect_seconds,
    }


def _from_json(content: dict[str, Any]) -> FrameResult:
    detection = Detection(
        np.array(content["point_index"], dtype=int),
        np.array(content["pixels"], dtype=float).reshape(-1, 2),
        content["reason"],
        np.array(content["rejected"], dtype=float).reshape(-1, 2),
        content["remark"],
    )
    size = content["image_size"]
    return FrameResult(
        content["topic"],
        content["index"],
        content["stamp_ns"],
        content["name"],
        (int(size[0]), int(size[1])) if size else None,
        detection,
        content["error"],
        content["read_seconds"],
        content["detect_seconds"],
    )


def _parse(lines: Sequence[bytes]) -> tuple[dict[tuple[str, int], tuple[FrameResult, str]], int]:
    """What lines tell, with each image's fingerprint, and how many come before the first that is damaged.

    What follows that is looked at again.
    """
    results = {}
    for number, line in enumerate(lines):
        try:
            content = json.loads(line)
            result = _from_json(content)
            results[result.topic, result.index] = result, content["fingerprint"]
        except (ValueError, KeyError, TypeError, IndexError):
            return results, number
    return results, len(lines)
