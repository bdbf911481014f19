"""The server as a browser sees it, with a live calibrator behind it that nothing has been shown to."""

from __future__ import annotations

import contextlib
import gc
import http.client
import json
import re
import select
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("aiohttp", reason="aiohttp is not installed: pip install '.[web]'")

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.answer import Answer
from fisheye_ep_calib.live.calibrator import LiveCalibrator
from fisheye_ep_calib.live.settings import CameraSettings, Settings, Tuning
from fisheye_ep_calib.simulation import paper_target
from fisheye_ep_calib.web import server as server_module
from fisheye_ep_calib.web.content import PageContent
from fisheye_ep_calib.web.server import PageServer
from fisheye_ep_calib.web.settings import WebSettings


class Nobody:
    """Listens to nothing."""

    def calibrated(self, camera, outcome) -> None: ...

    def wanted_pictures(self, camera) -> frozenset[str]:
        return frozenset()


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveCalibrator]:
    camera = CameraSettings("front", "/front/image_raw", False, paper_target(), "ep_odd", None, "", "")
    settings = Settings((camera,), tmp_path_factory.mktemp("page") / "results", resume=True, workers=1)
    live = LiveCalibrator(settings, Tuning(), Announcer(print, print), Nobody())  # type: ignore[arg-type]
    yield live
    live.stop()


class Page:
    """A server and someone who asks it. log: what it said."""

    def __init__(self, live: LiveCalibrator, settings: WebSettings) -> None:
        self.log: list[str] = []
        content = PageContent(live, lambda name: Answer(False, f"{name}: nobody serves it"), "calibrator")
        self.server = PageServer(content, settings, self.log.append)
        self.url = self.log[0].split()[-1]
        self.port = int(re.findall(r":(\d+)", self.url)[0])

    def ask(self, method: str, path: str, **headers: str) -> tuple[http.client.HTTPResponse, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method, path, headers={"Host": f"localhost:{self.port}", **named})
        response = connection.getresponse()
        return response, response.read()

    def status(self, method: str, path: str, **headers: str) -> int:
        return self.ask(method, path, **headers)[0].status

    @property
    def origin(self) -> str:
        return f"http://localhost:{self.port}"


@pytest.fixture
def page(live: LiveCalibrator) -> Iterator[Page]:
    page = Page(live, WebSettings(port=0))
    yield page
    page.server.stop()


def test_the_page_and_its_parts_come_from_the_package_alone(page: Page) -> None:
    for path, kind in (("/", "text/html"), ("/page.css", "text/css"), ("/page.js", "javascript"), ("/icon.svg", "svg")):
        response, content = page.ask("GET", path)
        assert response.status == 200 and kind in response.headers["Content-Type"]
        assert b"http://" not in content.replace(b"http://www.w3.org/2000/svg", b"") and b"https://" not in content
        assert "default-src 'none'" in response.headers["Content-Security-Policy"]
    assert json.loads(page.ask("GET", "/progress/front")[1])["cells"]


def test_foreign_names_and_foreign_pages_are_refused(page: Page) -> None:
    assert page.status("GET", "/", Host="evil.example") == 403
    assert page.status("POST", "/do/save") == 403  # no origin at all
    for origin in ("http://evil.example", "null", "http://localhost:1"):
        assert page.status("POST", "/do/save", Origin=origin) == 403
    response, content = page.ask("POST", "/do/save", Origin=page.origin)
    assert response.status == 200 and json.loads(content)["text"].startswith("front: 0 views")


def test_only_known_actions_cameras_and_methods(page: Page) -> None:
    for path in ("/do/delete", "/do/save?camera=rear", "/do/", "/do/__init__"):
        assert page.status("POST", path, Origin=page.origin) == 404
    assert page.status("GET", "/do/save") == 405
    assert page.status("PUT", "/do/save", Origin=page.origin) == 405
    assert page.status("GET", "/stream/rear") == 404 and page.status("GET", "/progress/..") == 404
    answer = json.loads(page.ask("POST", "/do/calibrate", Origin=page.origin)[1])
    assert not answer["success"] and "no view" in answer["text"]
    answer = json.loads(page.ask("POST", "/do/commit?camera=front", Origin=page.origin)[1])
    assert answer["text"] == "front: nobody serves it"


def test_no_file_from_outside_of_the_output_folder(page: Page, live: LiveCalibrator, tmp_path: Path) -> None:
    folder = live.folder
    (folder / "front.yaml").write_text("a: 1")
    (folder / "front_report.html").write_text("<p>report</p>")
    secret = tmp_path / "secret.yaml"
    secret.write_text("secret")
    (folder / "link.yaml").symlink_to(secret)
    (folder / "images.yaml").mkdir()
    names = {file["name"] for file in json.loads(page.ask("GET", "/files")[1])}
    assert names == {"front.yaml", "front_report.html"}
    response, content = page.ask("GET", "/files/front.yaml")
    assert content == b"a: 1" and 'filename="front.yaml"' in response.headers["Content-Disposition"]
    assert "sandbox" in page.ask("GET", "/files/front_report.html")[0].headers["Content-Security-Policy"]
    for path in ("link.yaml", ".owner", "..%2Fsecret.yaml", "%2Fetc%2Fpasswd", "images.yaml", "..", "%00"):
        assert page.status("GET", f"/files/{path}") == 404, path
    for path in ("/../../etc/passwd", "/static/page.html", "/page.py"):
        assert page.status("GET", path) == 404


def test_pictures_come_as_fast_as_they_are_taken_and_looking_ends(page: Page) -> None:
    assert not page.server.watched("front")
    with socket.create_connection(("127.0.0.1", page.port), timeout=10) as link:
        link.sendall(f"GET /stream/front HTTP/1.1\r\nHost: localhost:{page.port}\r\n\r\n".encode())
        got = b""
        for number in range(200):
            page.server.show("front", b"picture %d" % number)
            time.sleep(0.01)
            if number == 100:
                got = link.recv(1 << 20)
                assert page.server.watched("front")
        assert b"multipart/x-mixed-replace" in got and b"picture 9" in got
        assert got.count(b"Content-Type: image/jpeg") > 50
    wait_until = time.monotonic() + 10
    while page.server.watched("front") and time.monotonic() < wait_until:
        page.server.show("front", b"picture")
        time.sleep(0.05)
    assert not page.server.watched("front")


def test_who_goes_before_a_picture_comes_is_noticed(page: Page) -> None:
    """Or the page of a camera that sends nothing could be opened sixteen times, and by nobody from then on."""
    for _ in range(16):
        with socket.create_connection(("127.0.0.1", page.port), timeout=10) as link:
            link.sendall(f"GET /stream/front HTTP/1.1\r\nHost: localhost:{page.port}\r\n\r\n".encode())
            assert link.recv(1 << 12).startswith(b"HTTP/1.1 200")
    give_up = time.monotonic() + 10
    while page.server.watched("front") and time.monotonic() < give_up:
        time.sleep(0.02)
    assert not page.server.watched("front") and page.status("GET", "/stream/rear") == 404
    looking = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    looking.request("GET", "/events", headers={"Host": f"localhost:{page.port}"})
    assert looking.getresponse().status == 200
    looking.close()


def test_a_file_that_is_renamed_while_the_list_is_made_is_not_in_it(page: Page, live: LiveCalibrator) -> None:
    content = page.server.content
    there = live.folder / "there.npz"
    there.write_bytes(b"views")
    content._offered = lambda: {"there.npz": there, "gone.npz": live.folder / "gone.npz"}  # type: ignore[method-assign]
    assert [file["name"] for file in json.loads(page.ask("GET", "/files")[1])] == ["there.npz"]
    there.unlink()


def test_beyond_this_machine_a_token_is_asked_for(live: LiveCalibrator) -> None:
    page = Page(live, WebSettings("0.0.0.0", 0))
    try:
        token = page.url.partition("?token=")[2]
        assert len(token) >= 20
        for path in ("/", "/events", "/files", "/stream/front", "/?token=wrong"):
            assert page.status("GET", path) == 401
        assert page.status("POST", "/do/save", Origin=page.origin) == 401
        response, _ = page.ask("GET", f"/?token={token}")
        cookie = response.headers["Set-Cookie"]
        assert response.status == 303 and response.headers["Location"] == "/"
        assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
        known = cookie.split(";")[0]
        assert page.status("GET", "/", Cookie=known) == 200
        assert page.status("POST", "/do/save", Cookie=known, Origin=page.origin) == 200
        assert page.status("POST", "/do/save", Cookie=known, Origin="http://evil.example") == 403
    finally:
        page.server.stop()


def test_a_taken_port_is_passed_over_and_told(live: LiveCalibrator, page: Page, monkeypatch) -> None:
    second = Page(live, WebSettings(port=page.port))
    assert page.port < second.port <= page.port + 5
    second.server.stop()
    monkeypatch.setattr(server_module, "PORTS", 1)
    with pytest.raises(CalibrationError, match="web_port"):
        Page(live, WebSettings(port=page.port))
    with pytest.raises(CalibrationError, match="web_address"):
        Page(live, WebSettings("no such name.invalid", 0))


def test_a_crowd_that_says_nothing_is_turned_away(page: Page) -> None:
    """Connections are files of the node's: it has others to write. Who looks stays."""
    looking = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    looking.request("GET", "/events", headers={"Host": f"localhost:{page.port}"})
    events = looking.getresponse()
    crowd = []
    for _ in range(200):
        crowd.append(socket.create_connection(("127.0.0.1", page.port), timeout=10))
        crowd[-1].sendall(b"GET / HTTP/1.1")
    first = crowd[0].recv(1)  # waits until it is closed
    assert first == b"" and page.status("GET", "/") == 200
    time.sleep(0.5)
    assert events.readline().startswith(b"data: ")
    still_there = 0
    for one in crowd:
        one.settimeout(0.01)
        try:
            still_there += one.recv(1) != b""
        except TimeoutError:
            still_there += 1
        one.close()
    assert still_there <= 64
    looking.close()


def test_a_crowd_that_asks_and_does_not_read_leaves_no_trace(page: Page, caplog) -> None:
    crowd = []
    for _ in range(100):
        crowd.append(socket.socket())
        crowd[-1].setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        crowd[-1].connect(("127.0.0.1", page.port))
        with contextlib.suppress(OSError):  # turned away already
            crowd[-1].sendall(f"GET /page.js HTTP/1.1\r\nHost: localhost:{page.port}\r\n\r\n".encode() * 200)
    time.sleep(0.5)
    for one in crowd:
        one.close()
    assert page.status("GET", "/page.js") == 200
    page.server.stop()
    gc.collect()
    assert not [record.getMessage() for record in caplog.records if record.name == "asyncio"]


def test_more_pressing_than_can_be_done_is_refused(page: Page, monkeypatch) -> None:
    going_on, begun = threading.Event(), []
    monkeypatch.setattr(
        page.server.content, "act", lambda *_: begun.append(1) or Answer(going_on.wait(30), "done")
    )  # nothing ends before it is told to
    crowd = [socket.create_connection(("127.0.0.1", page.port), timeout=10) for _ in range(40)]
    for one in crowd:
        one.sendall(f"POST /do/save HTTP/1.1\r\nHost: localhost:{page.port}\r\nOrigin: {page.origin}\r\n\r\n".encode())
    refused: list[socket.socket] = []
    give_up = time.monotonic() + 20
    while len(refused) < 24 and time.monotonic() < give_up:
        refused = select.select(crowd, [], [], 0.1)[0]
    assert len(refused) == 24 and all(b"503" in one.recv(1 << 12).splitlines()[0] for one in refused)
    going_on.set()
    for one in crowd:
        assert one in refused or b'"success": true' in one.recv(1 << 12)
        one.close()
    assert len(begun) == 16 and page.status("POST", "/do/save", Origin=page.origin) == 200


def test_stopping_ends_streams_at_once(live: LiveCalibrator) -> None:
    page = Page(live, WebSettings(port=0))
    links = [socket.create_connection(("127.0.0.1", page.port), timeout=10) for _ in range(5)]
    for link in links:
        link.sendall(f"GET /events HTTP/1.1\r\nHost: localhost:{page.port}\r\n\r\n".encode())
        assert link.recv(1 << 16)
    began = time.monotonic()
    page.server.stop()
    assert time.monotonic() - began < 1.5
    assert not any(thread.name == "page" for thread in threading.enumerate())
    for link in links:
        link.close()
