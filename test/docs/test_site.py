"""The documentation as pages: no warning, every link and anchor leads somewhere, nothing comes from the network."""

from __future__ import annotations

import posixpath
import re
import subprocess
import sys
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

pytest.importorskip("furo", reason="the extra [docs] is not installed")
pytest.importorskip("myst_parser", reason="the extra [docs] is not installed")

DOCS = Path(__file__).resolve().parents[2] / "docs"
ELSEWHERE = ("http:", "https:", "//", "mailto:", "data:")
LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "link": "href"}


class Page(HTMLParser):
    """links and loaded: addresses as written; anchors: the ids."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.loaded: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given["id"]} if "id" in given else set()
        if tag == "a" and "href" in given:
            self.links.add(unescape(given["href"]))
        if LOADED.get(tag) in given and given.get("rel") not in ("canonical",):
            self.loaded.add(unescape(given[LOADED[tag]]))


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet", "-b", "html"]
    done = subprocess.run([*command, str(DOCS), str(folder)], capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site) -> dict[str, Page]:
    return {path.relative_to(site).as_posix(): Page(path.read_text("utf-8")) for path in site.rglob("*.html")}


def test_every_page_is_built(pages):
    assert {f"{path.stem}.html" for path in DOCS.glob("*.md")} <= pages.keys()


def test_links_and_anchors_lead_somewhere(site, pages):
    dead = []
    for name, page in pages.items():
        for link in page.links | page.loaded:
            if link.startswith(ELSEWHERE):
                continue
            path, _, anchor = link.partition("#")
            place = posixpath.join(posixpath.dirname(name), unquote(path.partition("?")[0])) if path else name
            place = posixpath.normpath(place)
            if not (site / place).exists() or (
                anchor and place in pages and unquote(anchor) not in pages[place].anchors
            ):
                dead.append(f"{name}: {link}")
    assert not dead


def test_nothing_is_loaded_from_the_network(site, pages):
    assert not {
        f"{name}: {link}" for name, page in pages.items() for link in page.loaded if link.startswith(ELSEWHERE[:3])
    }
    remote = re.compile(r"(?:url\(|@import\s)\s*[\"']?(?:https?:)?//")
    assert not [path for path in site.rglob("*.css") if remote.search(path.read_text("utf-8"))]
