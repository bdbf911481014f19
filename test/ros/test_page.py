"""The page in a real browser, before the real node over DDS: it shows, its buttons act, a phone is wide enough."""

from __future__ import annotations

import json
import re
import signal
import socket
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from headless_browser import HeadlessBrowser, chromium
from live_processes import Program, wait_for

from fisheye_ep_calib.storage.camera_file import load_camera

pytest.importorskip("aiohttp", reason="aiohttp is not installed: pip install '.[web]'")
pytestmark = pytest.mark.live

REPOSITORY = Path(__file__).resolve().parents[2]
TARGET = REPOSITORY / "config" / "targets" / "circle_grid_11x7.yaml"
EVERY_VIEW = {"novelty__position": 0.0, "novelty__size": 0.0, "novelty__tilt": 0.0}


@pytest.fixture
def browser():
    executable = chromium()
    if executable is None:
        pytest.skip("no Chromium here: apt-get install chromium")
    with HeadlessBrowser(executable) as browser:
        yield browser


def page_of(node: Program) -> str:
    """Where the node says that its page is."""
    node.wait_to_say("the page to look at: ")
    return re.findall(r"the page to look at: (\S+)", node.output)[0]


def text(browser: HeadlessBrowser, place: str) -> str:
    return str(browser.evaluate(f"document.getElementById({place!r}).textContent"))


def press(browser: HeadlessBrowser, action: str, before: str = "") -> None:
    browser.evaluate(f"{before}; document.querySelector('#camera [data-action={action}]').click()")


def answered(browser: HeadlessBrowser) -> str:
    """What the page says once the button that was pressed has done what it does."""
    return str(wait_for(lambda: "under way" not in (said := text(browser, "answer")) and said, "an answer"))


def status(browser: HeadlessBrowser, name: str = "front") -> dict[str, Any]:
    told = browser.evaluate(f"latest === null ? null : JSON.stringify(latest.cameras[{name!r}])")
    return {} if told is None else dict(json.loads(told))


def looked_at(told: dict[str, Any]) -> bool:
    """Whether every image that came has been: no view comes from then on."""
    return bool(told["received"] == told["searched"] + told["dropped"] + told["unreadable"])


def test_the_page_shows_streams_and_acts(start_calibrator, start_publisher, browser, rendered, tmp_path) -> None:
    folder = tmp_path / "results"
    node = start_calibrator(
        cameras="[front, rear]", target=TARGET, output_directory=folder, web_port=0, auto_calibrate="false",
        model="ep_odd", rear__topic="/nowhere", rig="true", **EVERY_VIEW,
    )  # fmt: skip
    browser.visit(page_of(node), width=1366, height=768)
    wait_for(lambda: text(browser, "say") == "Hold the target before the camera", "the first sentence")
    publisher = start_publisher(rendered, 5, "/front/image_raw")
    wait_for(lambda: "Kept" in text(browser, "sign"), "the sign of a kept view")
    wait_for(lambda: browser.evaluate("document.getElementById('stream').naturalWidth") == 1024, "the picture")
    frames = "new Promise(done => { const c = document.createElement('canvas'); c.width = c.height = 64;"
    frames += "c.getContext('2d').drawImage(document.getElementById('stream'), 0, 0, 64, 64); done(c.toDataURL()); })"
    seen: set[str] = set()
    wait_for(lambda: seen.add(browser.evaluate(frames)) or len(seen) >= 3, "three pictures that differ")
    wait_for(lambda: status(browser)["views"] >= 8, "eight views")
    assert "Hold the target" in text(browser, "say")
    assert browser.evaluate("at('views').textContent === String(latest.cameras.front.views)")
    publisher.end()
    wait_for(lambda: "No image" in text(browser, "say"), "the camera to be missed")
    wait_for(lambda: looked_at(status(browser)), "the last image to be looked at")

    press(browser, "calibrate")
    assert "Front: ep_odd, RMS" in answered(browser)
    camera = load_camera(folder / "front.yaml")
    assert camera.model == "ep_odd"
    wait_for(lambda: not browser.evaluate("document.getElementById('pupil-figure').hidden"), "E(θ)")
    wait_for(lambda: "%" in text(browser, "covered") and text(browser, "rms").endswith("px"), "the numbers")
    assert text(browser, "concerns")
    wait_for(lambda: "front.yaml" in text(browser, "files"), "the files")
    press(browser, "commit")
    assert "nobody serves /front/set_camera_info" in answered(browser)
    press(browser, "save")
    assert "Front: ep_odd" in answered(browser)

    views = status(browser)["views"]
    press(browser, "reset")
    assert f"All {views} views" in text(browser, "ask-text")
    # At once, so that the first dialog's close is told while the second is open.
    press(browser, "reset", before="document.querySelector('#ask [value=no]').click()")
    browser.evaluate("new Promise(done => setTimeout(done, 100))")
    assert status(browser)["views"] == views and (folder / "front.npz").exists()
    browser.evaluate("document.querySelector('#ask [value=yes]').click()")
    wait_for(lambda: status(browser)["views"] == 0, "the reset")
    assert f"{views} views set aside" in answered(browser) and not (folder / "front.npz").exists()

    browser.evaluate("document.querySelector('#tabs [data-name=rear]').click()")
    wait_for(lambda: "No image on /nowhere" in text(browser, "say"), "the other camera")
    browser.evaluate("document.querySelector('#tabs [data-name=\" rig\"]').click()")
    wait_for(lambda: "front and rear both see it" in text(browser, "rig-say"), "the rig")
    pictures = "[...document.querySelectorAll('#rig-pictures img')].map(i => new URL(i.src).pathname).join()"
    assert browser.evaluate(pictures) == "/stream/front,/stream/rear"
    assert browser.complaints() == []
    assert all(url.startswith(page_of(node)) for url in browser.requests())
    assert node.interrupt()[0] == 0 and "Traceback" not in node.output
    wait_for(lambda: text(browser, "link") == "the node does not answer", "the page to say that the node is gone")


def asleep(browser: HeadlessBrowser) -> None:
    """As after a minute in which the page, or its link, slept."""
    browser.evaluate("heardAt -= 60000")


def cameras_shown(browser: HeadlessBrowser) -> str:
    return str(browser.evaluate("[...document.querySelectorAll('#tabs button')].map(tab => tab.textContent).join()"))


def picture_is_there(browser: HeadlessBrowser) -> bool:
    there = "document.querySelector('.picture').classList.contains('empty') ? 0 : at('stream').naturalWidth"
    return bool(browser.evaluate(there) == 1024)


def test_the_page_outlives_its_node_and_a_link_that_ends_without_a_word(
    start_calibrator, start_publisher, browser, rendered, tmp_path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    common = {"target": TARGET, "web_port": port, "rear__topic": "/front/image_raw", "auto_calibrate": "false"}
    node = start_calibrator(cameras="[front, rear]", output_directory=tmp_path / "first", **common)
    browser.visit(page_of(node) + "/#rear", width=1366, height=768)
    start_publisher(rendered, 5, "/front/image_raw")
    wait_for(lambda: picture_is_there(browser), "the picture")

    node.process.send_signal(signal.SIGSTOP)
    asleep(browser)
    wait_for(lambda: text(browser, "link") == "the node does not answer", "the silence to be told")
    node.process.send_signal(signal.SIGCONT)
    wait_for(lambda: text(browser, "link") != "the node does not answer", "the node to be heard again")
    wait_for(lambda: picture_is_there(browser), "the picture to come back")

    press(browser, "reset")
    assert "calibration of rear are set aside" in text(browser, "ask-text")
    node.end()
    wait_for(lambda: text(browser, "link") == "the node does not answer", "the node's end")
    node = start_calibrator(cameras="[front, left]", output_directory=tmp_path / "second", **common)
    wait_for(lambda: cameras_shown(browser) == "front,left", "the node of other cameras")
    browser.evaluate("document.querySelector('#ask [value=yes]').click()")
    assert answered(browser) == "The node has no such camera"
    assert [url.partition("/do/")[2] for url in browser.requests() if "/do/" in url] == ["reset?camera=rear"]
    node.end()

    start_calibrator(cameras="[front, rear]", output_directory=tmp_path / "third", rig="true", **common)
    wait_for(lambda: cameras_shown(browser) == "front,rear,rig", "the first cameras")
    assert browser.evaluate("chosen") == "rear"
    wait_for(lambda: picture_is_there(browser), "the picture of the node that was started anew")


def test_on_a_slow_link_nothing_late_takes_the_place_of_what_is_newer(start_calibrator, browser, tmp_path) -> None:
    node = start_calibrator(cameras="[front, rear]", target=TARGET, output_directory=tmp_path, web_port=0)
    browser.visit(page_of(node) + "/#%", width=1366, height=768)
    wait_for(lambda: text(browser, "say") == "Hold the target before the camera", "the first sentence")

    wait_for(lambda: not browser.evaluate("refreshing"), "the charts")
    browser.evaluate("events.close(); heardAt = Infinity; 0")  # what the node says would come between

    # Versions change faster than a slow link tells the first: one is fetched at a time, and the last of all is shown.
    browser.evaluate("""{
        window.straight = window.fetch;
        window.underWay = window.most = window.broken = 0;
        window.asked = [];
        window.fetch = async (path, options) => {
            if (path === "files" && broken) throw new Error("broken");
            if (!path.startsWith("progress")) return straight(path, options);
            most = Math.max(most, ++underWay);
            asked.push(latest.cameras.front.version);
            await new Promise(later => setTimeout(later, 100));
            return straight(path, options).finally(() => { underWay -= 1; });
        };
        for (let k = 1; k <= 5; k += 1) { latest.cameras.front.version = `test ${k}`; show(); }
    }""")
    wait_for(lambda: browser.evaluate("asked.length > 1 && !refreshing"), "the charts of the last version")
    assert browser.evaluate("[most, ...asked]") == [1, "test 1", "test 5"]

    # What was told of one camera does not stay for another.
    sign = browser.evaluate("""(() => {
        latest.cameras.front.look = { event: "kept", number: 7, points: 77, of: 77, view: 3 };
        latest.cameras.rear.look = { event: "no target", number: 7, points: 0, of: 77, view: 0 };
        show();
        const before = at("sign").textContent;
        const late = at("stream");
        document.querySelector("#tabs [data-name=rear]").click();
        late.dispatchEvent(new Event("load"));
        return [before, at("sign").textContent, document.querySelector(".picture").className];
    })()""")
    assert sign[0].startswith("Kept") and sign[1] == "No target" and sign[2] == "picture empty"

    # An action's answer stays though the list of files cannot be had after it.
    browser.evaluate("broken = 1")
    press(browser, "save")
    assert answered(browser).startswith("Front: ")
    browser.evaluate("new Promise(done => setTimeout(done, 50))")
    assert answered(browser).startswith("Front: ")
    # A question answered and asked again at once: both answers count.
    browser.evaluate("window.answers = []; ask('first').then(yes => answers.push(yes)); 0")
    browser.evaluate(
        "document.querySelector('#ask [value=yes]').click(); ask('second').then(yes => answers.push(yes)); 0"
    )
    browser.evaluate("document.querySelector('#ask [value=no]').click(); new Promise(done => setTimeout(done, 100))")
    assert browser.evaluate("answers") == [True, False]
    assert browser.complaints() == []


def test_on_a_phone_and_on_a_desk(start_calibrator, start_publisher, browser, rendered, tmp_path) -> None:
    node = start_calibrator(cameras="[front]", target=TARGET, output_directory=tmp_path, web_port=0, model="ep_odd")
    start_publisher(rendered, 5, "/front/image_raw")
    for width, height, least in ((390, 844, 30), (1366, 768, 44)):
        browser.visit(page_of(node), width=width, height=height)
        wait_for(lambda: text(browser, "sign") and text(browser, "say"), "the page")
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
        size = browser.evaluate("parseFloat(getComputedStyle(document.getElementById('say')).fontSize)")
        assert size >= least  # pixels: a third of an inch is read from two metres
        heights = browser.evaluate(
            "[...document.querySelectorAll('button')].filter(b => b.offsetParent).map(b => b.offsetHeight)"
        )
        assert min(heights) >= 36
        assert browser.complaints() == []
        browser.screenshot(tmp_path / f"page_{width}.png")


def test_where_the_page_is_not_wanted_or_cannot_be(start_calibrator, tmp_path, monkeypatch) -> None:
    off = start_calibrator(cameras="[front]", target=TARGET, output_directory=tmp_path / "a", web="false")
    off.wait_to_say("nobody publishes")
    assert "the page to look at" not in off.output
    wrong = start_calibrator(
        cameras="[front]", target=TARGET, output_directory=tmp_path / "b", web_address="no such name.invalid"
    )
    wrong.wait_to_say("no page to look at: parameter web_address no such name.invalid")
    assert off.interrupt()[0] == 0 and wrong.interrupt()[0] == 0


def cpu_seconds(process: int) -> float:
    """Of a process and its children, user and system, so far."""
    own = [process]
    for path in Path(f"/proc/{process}/task").glob("*/children"):
        own += map(int, path.read_text().split())
    ticks = 0
    for number in own:
        fields = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / 100


@pytest.mark.slow
def test_looking_costs_little(start_calibrator, start_publisher, browser, rendered, tmp_path) -> None:
    """CPU of the node and its workers for each image looked at, ten a second, with the page open and without."""
    node = start_calibrator(
        cameras="[front]", target=TARGET, output_directory=tmp_path, web_port=0, auto_calibrate="false"
    )
    url = page_of(node)
    start_publisher(rendered, 10, "/front/image_raw")
    browser.visit(url, width=1366, height=768)
    wait_for(lambda: status(browser).get("views", 0) >= 5, "most of what is new")
    costs: dict[bool, list[float]] = {True: [], False: []}
    for turn in range(6):
        opened = turn % 2 == 0
        browser.visit(url if opened else "about:blank", width=1366, height=768)
        time.sleep(2)
        before, looks = cpu_seconds(node.process.pid), searched(url)
        time.sleep(15)
        costs[opened].append((cpu_seconds(node.process.pid) - before) / (searched(url) - looks))
    with_page, without = (float(np.median(costs[opened])) for opened in (True, False))
    told = f"{1e3 * with_page:.0f} ms with the page, {1e3 * without:.0f} ms without: {with_page / without:.3f} ×"
    print(f"CPU an image: {told}")
    assert with_page <= 1.15 * without, costs


def searched(url: str) -> int:
    import urllib.request

    with urllib.request.urlopen(f"{url}/events") as events:
        return int(json.loads(events.readline().decode().removeprefix("data: "))["cameras"]["front"]["look"]["number"])
