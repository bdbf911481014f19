"""Serves the page from a thread with an event loop of its own, so that no image waits for a browser."""

from __future__ import annotations

import asyncio
import importlib.util
import select
import socket
import threading
from collections.abc import Callable

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.web.access import Access
from fisheye_ep_calib.web.content import PageContent
from fisheye_ep_calib.web.pictures import LatestPictures
from fisheye_ep_calib.web.settings import WebSettings

PORTS = 20  # that are tried, one after the other
_LONGEST_END = 1.0  # seconds for the thread to end


class PageServer:
    """Serves from the moment it is made until it is stopped."""

    def __init__(self, content: PageContent, settings: WebSettings, say: Callable[[str], None]) -> None:
        """say: told where the page is. Raises CalibrationError where it cannot be served."""
        if importlib.util.find_spec("aiohttp") is None:
            raise CalibrationError(
                "the Python package aiohttp is not installed: apt install python3-aiohttp, or pip install aiohttp"
            )
        self.content = content
        self._access = Access(settings.local)
        self._pictures = LatestPictures()
        self._socket = _listen(settings)
        self._stopping, self._stopped = socket.socketpair()
        self._thread = threading.Thread(target=self._run, daemon=True, name="page")
        self._thread.start()
        say(f"the page to look at: {self._url(settings)}")

    def watched(self, camera: str) -> bool:
        """Whether anybody looks at the camera's pictures."""
        return self._pictures.watched(camera)

    def show(self, camera: str, picture: bytes) -> None:
        """The camera's newest picture, JPEG."""
        self._pictures.show(camera, picture)

    def stop(self) -> None:
        """End at once; whoever looks is cut off."""
        self._stopping.close()
        self._thread.join(_LONGEST_END)

    def _url(self, settings: WebSettings) -> str:
        port = self._socket.getsockname()[1]
        if settings.local:
            return f"http://localhost:{port}"
        host = socket.gethostname() if settings.address in ("0.0.0.0", "::") else settings.address
        host = f"[{host}]" if ":" in host else host
        return f"http://{host}:{port}/?token={self._access.token}"

    def _run(self) -> None:
        """Nothing is loaded, and no time taken, until somebody looks for the first time."""
        with self._socket, self._stopped:
            ready, _, _ = select.select([self._socket, self._stopped], [], [])
            if self._stopped in ready:
                return
            from fisheye_ep_calib.web.application import serve

            asyncio.run(serve(self.content, self._pictures, self._access, self._socket, self._stopped))


def _listen(settings: WebSettings) -> socket.socket:
    """A socket at the first port that is free. Raises CalibrationError."""
    reason = ""
    ports = [0] if settings.port == 0 else range(settings.port, min(settings.port + PORTS, 65536))
    for port in ports:
        try:
            family = socket.getaddrinfo(settings.address, port, type=socket.SOCK_STREAM)[0][0]
            listening = socket.socket(family, socket.SOCK_STREAM)
        except (OSError, UnicodeError) as error:
            raise CalibrationError(f"`web_address` {settings.address}: {error}") from None
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind((settings.address, port))
            listening.listen(64)
        except OSError as error:
            listening.close()
            reason = error.strerror or str(error)
            continue
        return listening
    raise CalibrationError(f"`web_port` {settings.port} and the {PORTS - 1} after it cannot be had: {reason}")
