"""The page in a real browser: no complaint, no request, tables sort, pictures open, it fits a phone."""

from __future__ import annotations

import shutil
import subprocess

import pytest
from headless_browser import HeadlessBrowser, chromium


@pytest.fixture(scope="module")
def page(text, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def browser():
    executable = chromium()
    if executable is None:
        pytest.skip("no Chromium here: apt-get install chromium")
    try:
        with HeadlessBrowser(executable) as started:
            yield started
    except TimeoutError as error:
        pytest.skip(f"{executable} does not start here: {error}")


def test_loads_without_complaint_and_asks_for_nothing(browser, page):
    browser.open(page)
    assert browser.complaints() == []
    assert browser.requests() == []
    assert browser.evaluate("typeof alert === 'function' && document.querySelectorAll('[onerror]').length") == 0


def test_table_sorts_up_and_down(browser, page, report):
    browser.open(page)
    column = "[...document.querySelectorAll('.views-table')[0].tBodies[0].rows].map(r => r.cells[1].dataset.value)"
    press = "document.querySelectorAll('.views-table')[0].tHead.rows[0].cells[1].querySelector('button').click()"
    values = sorted(view.rms_px for view in report.views)
    assert [float(one) for one in browser.evaluate(column)] == values[::-1]
    browser.evaluate(press)
    assert [float(one) for one in browser.evaluate(column)] == values
    browser.evaluate(press)
    assert [float(one) for one in browser.evaluate(column)] == values[::-1]
    names = "[...document.querySelectorAll('.models')[0].tBodies[0].rows].map(r => r.cells[0].textContent)"
    browser.evaluate("document.querySelector('.models th button').click()")
    found = browser.evaluate(names)
    assert found == sorted(found) and len(found) == len(report.models)


def test_pictures_are_images_and_open_large(browser, page, report):
    browser.open(page)
    decoded = "Promise.all([...document.images].map(i => i.decode())).then(() => true)"
    assert browser.evaluate(decoded)
    assert browser.evaluate("document.images.length") == 2 * sum(view.picture is not None for view in report.views)
    browser.evaluate("document.querySelector('.view button').click()")
    assert browser.evaluate("document.getElementById('viewer').open")
    wide = browser.evaluate("document.querySelector('.stage img').getBoundingClientRect().width")
    assert wide > 2 * browser.evaluate("document.querySelector('.view img').getBoundingClientRect().width")
    browser.evaluate("document.querySelector('#viewer .close').click()")
    assert not browser.evaluate("document.getElementById('viewer').open")
    browser.evaluate("document.querySelector('.panel .enlarge').click()")
    assert browser.evaluate("document.querySelector('.stage svg').getBoundingClientRect().width") > 600


@pytest.mark.parametrize("width", [320, 390, 1280])
def test_nothing_sticks_out(browser, page, width):
    browser.open(page, width, 800)
    browser.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    assert browser.evaluate("document.documentElement.scrollWidth") <= width


def test_dark_and_light_and_paper(browser, page, tmp_path):
    ink = "getComputedStyle(document.querySelector('.panel svg text')).fill"
    paper = "getComputedStyle(document.body).backgroundColor"
    seen = set()
    for dark in (False, True):
        browser.open(page, dark=dark)
        seen.add((browser.evaluate(ink), browser.evaluate(paper)))
    assert len(seen) == 2
    browser.open(page, dark=True, media="print")
    assert browser.evaluate(paper) == "rgb(255, 255, 255)"
    browser.open(page, 720, 1000, media="print")  # A4 between its margins
    browser.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    assert browser.evaluate("document.documentElement.scrollWidth") <= 720
    browser.pdf(tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")


def test_no_heading_stands_alone_at_the_foot_of_a_page(browser, page, tmp_path):
    tool = shutil.which("pdftotext")
    if tool is None:
        pytest.skip("pdftotext, of poppler-utils, is not here")
    for pushed in range(0, 1100, 120):  # px, further than a page is high
        browser.open(page, 720, 1000, media="print")
        spacer = f"<div style='height: {pushed}px'></div>"
        browser.evaluate(f"document.getElementById('camera-1-views').insertAdjacentHTML('beforebegin', \"{spacer}\")")
        browser.pdf(tmp_path / "report.pdf")
        text = subprocess.run([tool, tmp_path / "report.pdf", "-"], capture_output=True, text=True, check=True).stdout
        sheet = next(sheet for sheet in text.split("\f") if "Views, the worst first" in sheet)
        assert "px RMS" in sheet.split("Views, the worst first")[1]
