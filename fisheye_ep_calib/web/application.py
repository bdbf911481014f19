"""What is served under which path."""

from __future__ import annotations

import asyncio
import json
import logging
import socket
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from aiohttp import web

from fisheye_ep_calib.storage.json_text import plain
from fisheye_ep_calib.web.access import COOKIE, Access
from fisheye_ep_calib.web.content import PageContent
from fisheye_ep_calib.web.pictures import LatestPictures

STATIC = Path(__file__).with_name("static")
_STATIC_FILES = {"/": "page.html", "/page.css": "page.css", "/page.js": "page.js", "/icon.svg": "icon.svg"}
_ACTIONS = ("calibrate", "save", "reset", "commit", "report")
_EVENT_SECONDS = 0.1  # between looks whether there is something new to tell
_HEARTBEATS = 20  # looks after which the page is told all the same: it listens anew after five times as long
_SHOWN_SECONDS = 0.15  # after which a picture that no other has followed is sent again
_GONE_SECONDS = 0.5  # after which it is looked whether who waits for a picture is still there
_MOST_LOOKING = 16  # streams at a time
_MOST_ACTING = 4  # buttons that do what they do at a time
_MOST_PRESSED = 16  # that do or wait for it: more would wait for hours, and take memory
_MOST_CONNECTIONS = 64  # that look at nothing: more would take the node's files, of which it has some thousand
_POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
_POLICY += "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
_REPORT_POLICY = "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
_REPORT_POLICY += "img-src data:; font-src data:"
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


async def serve(
    content: PageContent, pictures: LatestPictures, access: Access, listening: socket.socket, stopped: socket.socket
) -> None:
    """Serve until the other end of ``stopped`` is closed."""
    stopped.setblocking(False)
    logging.getLogger("aiohttp").setLevel(logging.CRITICAL)  # the node's log is the one that is read
    # asyncio's own leaves its task behind, with a traceback, where a connection is closed in the middle of a file.
    asyncio.get_running_loop().sendfile = _without_sendfile  # type: ignore[method-assign]
    application = Application(content, pictures, access)
    runner = web.AppRunner(application.app, access_log=None, shutdown_timeout=0.1)
    await runner.setup()
    await web.SockSite(runner, listening).start()
    crowd = asyncio.create_task(application.turn_away_the_crowd(runner))
    await asyncio.get_running_loop().sock_recv(stopped, 1)
    crowd.cancel()
    application.end()
    await runner.cleanup()


async def _without_sendfile(*_given: object, **_options: object) -> int:
    """As a loop answers that knows no such call, so that the file is read and written instead."""
    raise NotImplementedError


class Application:
    """Paths and what answers them."""

    def __init__(self, content: PageContent, pictures: LatestPictures, access: Access) -> None:
        self._content = content
        self._pictures = pictures
        self._access = access
        self._looking: set[object] = set()  # connections
        self._pressed = 0
        self._acting = ThreadPoolExecutor(_MOST_ACTING, "page action")
        self.app = web.Application(middlewares=[self._guarded], client_max_size=4096)
        for path, name in _STATIC_FILES.items():
            self.app.router.add_get(path, partial(self._static, name))
        self.app.router.add_get("/events", self._events)
        self.app.router.add_get("/stream/{camera}", self._stream)
        self.app.router.add_get("/progress/{camera}", self._progress)
        self.app.router.add_get("/files", self._files)
        self.app.router.add_get("/files/{name}", self._file)
        self.app.router.add_post("/do/{action}", self._act)

    def end(self) -> None:
        self._acting.shutdown(wait=False, cancel_futures=True)

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        host = request.headers.get("Host", "")
        if not self._access.is_our_name(host):
            return _refusal(403, "this is no name of this machine")
        shown = request.query.get("token", "")
        if shown and self._access.token and self._access.knows(shown):
            response = web.Response(status=303, headers={**_HEADERS, "Location": "/"})
            response.set_cookie(COOKIE, shown, httponly=True, samesite="Strict")
            return response
        if not self._access.knows(request.cookies.get(COOKIE, "")):
            return _refusal(401, "open the address with the token that the node's log tells")
        if request.method == "POST" and not self._access.is_our_page(request.headers.get("Origin", ""), host):
            return _refusal(403, "only the page itself may act")
        if request.method not in ("GET", "HEAD", "POST"):
            return _refusal(405, "not allowed")
        try:
            return await handler(request)
        except web.HTTPException as error:
            return _refusal(error.status, error.reason)

    async def _static(self, name: str, _request: web.Request) -> web.StreamResponse:
        return web.FileResponse(STATIC / name, headers=_HEADERS)

    async def _events(self, request: web.Request) -> web.StreamResponse:
        """Server-sent events: a snapshot whenever something has changed."""
        response = web.StreamResponse(headers={**_HEADERS, "Content-Type": "text/event-stream"})
        with self._look(request):
            await response.prepare(request)
            told, quiet = "", 0
            while True:
                text = json.dumps(plain(self._content.snapshot()))
                quiet += 1
                if text != told or quiet >= _HEARTBEATS:
                    await response.write(f"data: {text}\n\n".encode())
                    told, quiet = text, 0
                await asyncio.sleep(_EVENT_SECONDS)

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        """Motion JPEG: the newest picture, again and again, as fast as it comes and the link takes it.

        Chromium shows a picture once another follows: one that none follows is sent a second time. Who goes while
        no picture comes is noticed too.
        """
        camera = self._camera(request)
        response = web.StreamResponse(headers={**_HEADERS, "Content-Type": "multipart/x-mixed-replace; boundary=frame"})
        self._pictures.begin(camera)
        try:
            with self._look(request):
                await response.prepare(request)
                await response.write(b"--frame\r\n")
                number, picture, shown = 0, b"", True
                while True:
                    patience = _GONE_SECONDS if shown else _SHOWN_SECONDS
                    try:
                        number, picture = await asyncio.wait_for(self._pictures.after(camera, number), patience)
                        shown = False
                    except asyncio.TimeoutError:
                        if request.transport is None:
                            return response
                        if shown:
                            continue
                        shown = True
                    head = f"Content-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
                    await response.write(head.encode() + picture + b"\r\n--frame\r\n")
        finally:
            self._pictures.end(camera)

    async def _progress(self, request: web.Request) -> web.StreamResponse:
        return web.json_response(plain(self._content.progress(self._camera(request))), headers=_HEADERS)

    async def _files(self, _request: web.Request) -> web.StreamResponse:
        return web.json_response(self._content.files(), headers=_HEADERS)

    async def _file(self, request: web.Request) -> web.StreamResponse:
        path = self._content.file(request.match_info["name"])
        if path is None:
            raise web.HTTPNotFound
        if path.suffix == ".html":
            return web.FileResponse(path, headers={**_HEADERS, "Content-Security-Policy": _REPORT_POLICY})
        disposition = f'attachment; filename="{path.name}"' if path.name.isascii() else "attachment"
        return web.FileResponse(path, headers={**_HEADERS, "Content-Disposition": disposition})

    async def _act(self, request: web.Request) -> web.StreamResponse:
        action, camera = request.match_info["action"], request.query.get("camera")
        if action not in _ACTIONS or (camera is not None and camera not in self._content.names):
            raise web.HTTPNotFound(reason="the node has no such camera")
        if self._pressed >= _MOST_PRESSED:
            raise web.HTTPServiceUnavailable(reason="too much is under way already: wait for it")
        loop = asyncio.get_running_loop()
        self._pressed += 1
        try:
            answer = await loop.run_in_executor(self._acting, self._content.act, action, camera)
        finally:
            self._pressed -= 1
        return web.json_response({"success": answer.success, "text": answer.text}, headers=_HEADERS)

    def _camera(self, request: web.Request) -> str:
        camera = request.match_info["camera"]
        if camera not in self._content.names:
            raise web.HTTPNotFound
        return camera

    @contextmanager
    def _look(self, request: web.Request) -> Iterator[None]:
        """One more who looks, for as long as that takes."""
        if len(self._looking) >= _MOST_LOOKING:
            raise web.HTTPServiceUnavailable
        self._looking.add(request.protocol)
        try:
            yield
        finally:
            self._looking.discard(request.protocol)

    async def turn_away_the_crowd(self, runner: web.AppRunner) -> None:
        """Close what has been connected longest and looks at nothing, where there are too many of it; without end."""
        while True:
            await asyncio.sleep(_EVENT_SECONDS)
            connections = runner.server.connections if runner.server else []
            idle = [connection for connection in connections if connection not in self._looking]
            for connection in idle[:-_MOST_CONNECTIONS]:
                connection.force_close()


def _refusal(status: int, reason: str) -> web.Response:
    return web.Response(status=status, text=f"{reason}\n", headers=_HEADERS)
