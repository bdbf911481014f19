"""The images of the views that are kept, as PNG files beside them: for another look at them later."""

from __future__ import annotations

import threading
import time
from collections import deque
from itertools import count
from pathlib import Path

import cv2
import numpy as np

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.frame import RawFrame
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.storage.grey_levels import to_levels
from fisheye_ep_calib.storage.images import grey_image, grey_of_compressed

_RECENT = 8  # frames of a camera that another camera's view may still ask for
_MOST_WAITING = 50  # images that wait for the disk; of more, the oldest are given up
_COMPRESSION = 1  # of 9: higher takes several times as long for a few percent
_BELOW, _STEPS = 128, 128  # of real numbers: grey levels from -128 to 384, of which the scene has 0 to 255, in steps


class KeptImages:
    """One folder a camera, images/<camera>, one file a view, called after it; safe to use from several threads."""

    def __init__(self, folder: Path, wanted: bool, announcer: Announcer) -> None:
        """folder: that of all results. wanted: otherwise nothing is stored. announcer: told what the disk refuses."""
        self._announcer = announcer
        self._folder = folder / "images"
        self._wanted = wanted
        self._recent: dict[str, deque[RawFrame]] = {}
        self._waiting: deque[tuple[Path, bytes]] = deque()
        self._lock = threading.Lock()

    def offer(self, camera: str, frame: RawFrame) -> None:
        """A frame that may be kept: now, or soon because of another camera's."""
        if self._wanted:
            with self._lock:
                self._recent.setdefault(camera, deque(maxlen=_RECENT)).append(frame)

    def keep(self, camera: str, name: str) -> None:
        """Store the frame of that name."""
        with self._lock:
            frames = [frame for frame in self._recent.get(camera, ()) if frame.name == name]
        if frames:
            content = _png(frames[-1])
            with self._lock:
                self._waiting.append((self._unused(camera, name), content))
            self.write()

    def write(self) -> None:
        """Write what waits; call it now and then."""
        with self._lock:
            while len(self._waiting) > _MOST_WAITING:
                self._waiting.popleft()
            try:
                while self._waiting:
                    atomic_write(*self._waiting[0])
                    self._waiting.popleft()
            except CalibrationError as error:
                text = f"{error}; images of kept views wait, the latest {_MOST_WAITING} of them"
                self._announcer.warn_once("pool images", text)
            else:
                self._announcer.over("pool images", "the images that waited are written now")

    def _unused(self, camera: str, name: str) -> Path:
        """Where no earlier image is: names come back where a bag is played again, or a driver stamps nothing."""
        waiting = {path for path, _ in self._waiting}
        path = self._folder / camera / f"{name}.png"
        for number in count(2):
            if path not in waiting and not path.exists():
                break
            path = path.with_name(f"{name}_{number}.png")
        return path

    def set_aside(self, camera: str) -> None:
        """The camera starts anew; its earlier images are renamed."""
        with self._lock:
            self._recent.pop(camera, None)
            self._waiting = deque((path, content) for path, content in self._waiting if path.parent.name != camera)
            folder = self._folder / camera
            if not (self._wanted and folder.exists()):
                return
            aside = self._folder.with_name(f"images.{time.strftime('%Y%m%d-%H%M%S')}") / camera
            try:
                aside.parent.mkdir(parents=True, exist_ok=True)
                folder.rename(aside)
            except OSError as error:
                self._announcer.warning(f"{camera}: cannot rename {folder}: {error.strerror}; new images join the old")


def _png(frame: RawFrame) -> bytes:
    """The frame in grey, as deep as it came."""
    image = grey_of_compressed(frame) if frame.compressed else grey_image(frame)
    if image.dtype == np.float32:
        # Over the range of the scene: one pixel that is infinite would leave the others none.
        image = np.clip(np.rint((to_levels(image) + _BELOW) * _STEPS), 0, 65535).astype(np.uint16)
    content: np.ndarray = cv2.imencode(
        ".png", np.ascontiguousarray(image), [cv2.IMWRITE_PNG_COMPRESSION, _COMPRESSION]
    )[1]
    return content.tobytes()
