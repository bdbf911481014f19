"""What was found so far, on disk as it is found, so that an interrupted run goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import IO

import numpy as np

from fisheye_ep_calib.collection.results import FrameResult
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.storage.recording import Recording
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.detection import Detection

FORMAT = 1


class DetectionLog:
    """One line of JSON an image. A line that a crash left unfinished is dropped.

    known: (topic, image) → what an earlier run saw.
    """

    def __init__(self, path: Path, key: str, resume: bool) -> None:
        """key: what was searched and for what; an earlier log of another key is not resumed (InputError)."""
        self._path = path
        self.known: dict[tuple[str, int], FrameResult] = {}
        try:
            lines = path.read_text("utf-8").split("\n")[:-1] if resume and path.exists() else []
            path.parent.mkdir(parents=True, exist_ok=True)
            if lines:
                self._check(lines[0], key)
                self.known = _parse(lines[1:])
            self._file: IO[str] = open(path, "w", encoding="utf-8")
            self._write({"format": FORMAT, "key": key})
            for result in self.known.values():
                self._write(_to_json(result))
        except (OSError, UnicodeDecodeError) as error:
            raise CalibrationError(f"{path} cannot be used: {error}") from None

    def _check(self, line: str, key: str) -> None:
        try:
            head = json.loads(line)
            same = head["format"] == FORMAT and head["key"] == key
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{self._path} is damaged; run without --resume") from None
        if not same:
            raise InputError(f"{self._path} is of another recording or target; run without --resume")

    def add(self, result: FrameResult) -> None:
        """Remember an image; on disk when this returns, short of a power cut."""
        try:
            self._write(_to_json(result))
        except OSError as error:
            raise CalibrationError(f"cannot write {self._path}: {error.strerror or error}") from None

    def _write(self, content: dict) -> None:
        self._file.write(json.dumps(content, separators=(",", ":")) + "\n")
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    def remove(self) -> None:
        """Close and delete: the results are saved elsewhere."""
        self._file.close()
        self._path.unlink(missing_ok=True)


def search_key(recording: Recording, topics: Sequence[str], target: Target) -> str:
    """Names a search: the same images, by their times, and the same target, by its type and points."""
    digest = hashlib.sha256(type(target).__name__.encode())
    digest.update(np.ascontiguousarray(target.object_points, dtype="<f8").tobytes())
    digest.update(repr(target.disc_radius).encode())
    for topic in sorted(topics):
        stamps = np.array(recording.stamps(topic), dtype="<i8")
        digest.update(os.fsencode(topic) + b"\0" + stamps.tobytes())
    return digest.hexdigest()


def _to_json(result: FrameResult) -> dict:
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
        "read_seconds": result.read_seconds,
        "detect_seconds": result.detect_seconds,
    }


def _from_json(content: dict) -> FrameResult:
    detection = Detection(
        np.array(content["point_index"], dtype=int),
        np.array(content["pixels"], dtype=float).reshape(-1, 2),
        content["reason"],
        np.array(content["rejected"], dtype=float).reshape(-1, 2),
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


def _parse(lines: Sequence[str]) -> dict[tuple[str, int], FrameResult]:
    known = {}
    for line in lines:
        try:
            result = _from_json(json.loads(line))
        except (ValueError, KeyError, TypeError, IndexError):
            break  # what follows damage is looked at again
        known[result.topic, result.index] = result
    return known
