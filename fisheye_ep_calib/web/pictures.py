"""Each camera's newest picture, for as many who look as want it, each at the pace that its link takes."""

from __future__ import annotations

import asyncio
import threading


class LatestPictures:
    """Pictures come from any thread; those who look wait in one event loop."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[int, bytes]] = {}
        self._looking: dict[str, int] = {}
        self._changed: dict[str, asyncio.Event] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._lock = threading.Lock()

    def watched(self, camera: str) -> bool:
        """Whether anybody looks at the camera."""
        return self._looking.get(camera, 0) > 0

    def show(self, camera: str, picture: bytes) -> None:
        with self._lock:
            number = self._newest.get(camera, (0, b""))[0] + 1
            self._newest[camera] = number, picture
            loop, changed = self._loop, self._changed.get(camera)
        if loop is not None and changed is not None and not loop.is_closed():
            loop.call_soon_threadsafe(changed.set)

    def begin(self, camera: str) -> None:
        """Somebody begins to look; in the event loop."""
        with self._lock:
            self._loop = asyncio.get_running_loop()
            self._changed.setdefault(camera, asyncio.Event())
            self._looking[camera] = self._looking.get(camera, 0) + 1

    def end(self, camera: str) -> None:
        with self._lock:
            self._looking[camera] -= 1

    async def after(self, camera: str, number: int) -> tuple[int, bytes]:
        """The newest picture once there is one later than that of the number."""
        while True:
            changed = self._changed[camera]
            changed.clear()
            newest = self._newest.get(camera, (0, b""))
            if newest[0] > number:
                return newest
            await changed.wait()
