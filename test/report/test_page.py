"""The page is one file, escapes what comes from outside and says what the result says."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot

from fisheye_ep_calib import calibrate
from fisheye_ep_calib.report.figures import residuals, style
from fisheye_ep_calib.report.figures.board import draw_board
from fisheye_ep_calib.report.from_calibration import calibration_report
from fisheye_ep_calib.report.html import report_html, write_report
from fisheye_ep_calib.target.shape.measured import BoardShape


class Page(HTMLParser):
    """Tags, ids and text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag, attributes) -> None:
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data) -> None:
        self.text += data

    def values(self, attribute: str) -> list[str]:
        return [found[attribute] for _, found in self.tags if attribute in found]


@pytest.fixture(scope="module")
def page(text) -> Page:
    return Page(text)


def test_names_from_outside_stay_text(page, report):
    assert report.name in page.text
    assert not [tag for tag, found in page.tags if found.get("src") == "x" or "onerror" in found]
    for view in report.views:
        assert view.name in page.text


def test_nothing_is_loaded_from_elsewhere(page):
    assert all(url.startswith("#") for url in page.values("href"))
    assert all(url.startswith("data:image/") for url in page.values("src") + page.values("xlink:href") if url[0] != "#")
    assert not [tag for tag, found in page.tags if tag in ("link", "iframe", "object")]


def test_ids_are_unique_and_links_lead_somewhere(page):
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    inside = [url[1:] for url in page.values("href") + page.values("xlink:href") if url.startswith("#")]
    assert inside and set(inside) <= set(ids)
    assert set(page.values("data-enlarge")) <= set(ids)


def test_verdict_findings_and_rejected_points_are_told(page, report, result):
    assert report.verdict.headline in page.text
    for finding in result.diagnosis.findings:
        assert finding.sentence in page.text
    assert len(report.rejected) == len(result.rejected) == 3
    assert "3 rejected points" in page.text
    assert "1 image not used" in page.text


def test_every_figure_is_there(page):
    titles = re.findall(r"enlarge: ([^\"]*)", " ".join(f"{label}" for label in page.values("aria-label")))
    said = " ".join(titles)
    for wanted in (
        "Entrance pupil",
        "Lens",
        "Over the image",
        "Against the angle",
        "Against the distance",
        "angle and azimuth",
        "angle and distance",
        "Projection uncertainty at infinity",
        "Near against far",
    ):
        assert wanted in said


def test_few_numbers_are_bars_with_their_values(page, report, result):
    assert "What a single viewpoint loses" in page.text and "Where the residuals come from" in page.text
    for loss in result.stand_in.loss_px.values():
        assert f"{loss:.2g} px" in page.text
    assert f"{report.budget.corner_noise_px:.3f}" in page.text
    shares = [float(style.split(":")[1]) for style in page.values("style") if style.startswith("--share")]
    assert len(shares) == 2 * (5 + len(result.stand_in.loss_px)) and max(shares) == 1


def test_of_many_residuals_some_are_drawn_the_largest_among_them(report, monkeypatch):
    monkeypatch.setattr(residuals, "_MOST_DRAWN", 100)
    monkeypatch.setattr(residuals, "_LARGEST", 10)
    size = np.linalg.norm(report.residuals.error, axis=1)
    drawn = residuals._drawn(size)
    assert len(drawn) == len(set(drawn.tolist())) == 100
    assert set(np.argsort(size)[-10:].tolist()) <= set(drawn.tolist())
    assert f"100 of {len(size)} residuals" in report_html([report])


def test_nothing_of_a_figure_is_cut_off(report, monkeypatch):
    cut: dict[str, list[float]] = {}
    drawn = style.Figure.savefig

    def looked_at(figure, *arguments, **named) -> None:
        drawn(figure, *arguments, **named)
        box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
        cut[figure.axes[0].get_ylabel() or str(len(cut))] = [box.x0, box.y0, width - box.x1, height - box.y1]

    monkeypatch.setattr(style.Figure, "savefig", looked_at)
    points = report.board.object_points
    deviation = np.random.default_rng(1).normal(scale=1e-3, size=points.shape)
    report_html([replace(report, board=BoardShape("free", points, deviation, bent=True))])
    assert len(cut) >= 8 and {name: room for name, room in cut.items() if min(room) < -0.12} == {}


def test_figure_and_finding_say_the_same_of_the_coverage(report, result):
    missing, diagnosis = report.coverage.missing, result.diagnosis
    np.testing.assert_array_equal(missing, diagnosis.reachable & (diagnosis.counts == 0))
    for gaps, told in ((missing, f"Red: {missing.sum()} cell"), (missing & False, "Every cell of 15° × 45°")):
        page = report_html([replace(report, coverage=replace(report.coverage, missing=gaps))])
        assert (told in page) == (told[0] == "E" or bool(missing.any()))
    covered = [one.sentence for one in report.findings if "every part of the field" in one.sentence]
    assert bool(covered) != bool(missing.any())


def test_unreadable_picture_leaves_the_view_in_the_table(report):
    assert [view.picture is None for view in report.views].count(True) == 1


def test_same_report_gives_the_same_page_and_leaves_matplotlib_alone(report, text):
    before = dict(matplotlib.rcParams)
    assert report_html([report, replace(report, name="other")]) == text
    assert dict(matplotlib.rcParams) == before
    assert pyplot.get_fignums() == []


def test_camera_without_a_pupil(observations, tmp_path):
    result = calibrate(observations, model="kannala", skew=False)
    report = calibration_report("plain", observations, result)
    assert {model.name for model in report.models} == {"kannala", "ep_even"}
    write_report(tmp_path / "report.html", [report])
    assert "loses less than" in Page((tmp_path / "report.html").read_text()).text


def test_compared_models_are_the_ones_of_the_result(report, result):
    assert {model.name: model.rms_px for model in report.models} == {
        name: one.rms_px for name, one in result.comparison.items()
    }
    chosen = next(model for model in report.models if model.chosen)
    np.testing.assert_allclose(chosen.pupil, result.camera.entrance_pupil(chosen.theta))


def test_residuals_give_the_rms_of_the_result(report, result):
    square = (report.residuals.error**2).sum(axis=-1)
    assert np.sqrt(square.mean()) == pytest.approx(result.rms_px, rel=1e-9)
    rms = [view.rms_px for view in report.views]
    np.testing.assert_allclose(rms, result.diagnosis.view_rms_px, rtol=1e-9)


def test_a_bent_board_is_drawn_and_a_flat_one_told_in_a_line(report):
    points = report.board.object_points
    assert "The target: the board is taken as its file has it." in report_html([report])
    deviation = np.zeros_like(points)
    deviation[:, 2] = 1e-3 * (points[:, 0] / np.abs(points[:, 0]).max()) ** 2
    deviation[:, 0] = 3e-3 * points[:, 0]
    page = report_html([replace(report, board=BoardShape("free", points, deviation, bent=True))])
    assert "The target against its file" in page and "height, mm" in page and "times its size" in page
    assert "% longer in x than in y" in page and "The target: " not in page


def test_arrows_and_colours_of_the_board_are_its_deviation():
    from matplotlib.collections import PathCollection
    from matplotlib.figure import Figure
    from matplotlib.quiver import Quiver

    x, y = np.meshgrid(np.arange(4) * 0.02, np.arange(3) * 0.02)
    points = np.stack([x.ravel(), y.ravel(), np.zeros(12)], axis=-1)
    deviation = np.random.default_rng(1).normal(scale=1e-4, size=(12, 3))
    axes = Figure().add_subplot()
    factor = draw_board(axes, BoardShape("free", points, deviation))
    arrows = next(one for one in axes.get_children() if isinstance(one, Quiver))
    np.testing.assert_allclose(np.stack([arrows.U, arrows.V], -1), factor * 1e3 * deviation[:, :2])
    dots = next(one for one in axes.get_children() if isinstance(one, PathCollection))
    np.testing.assert_allclose(dots.get_array(), 1e3 * deviation[:, 2])


def test_the_first_screen_has_the_intrinsics_and_says_what_to_do(page, report):
    head = page.text[: page.text.index("Models")]
    for one in report.intrinsics:
        assert one.name in head and f"{one.value:.{3 if one.unit else 5}f}" in head.replace("−", "-")
    assert {"fx", "fy", "cx", "cy", "k1", "k4"} <= {one.name for one in report.intrinsics}
    assert report.verdict.use in ("Use it.", "Use it with care.", "Do not use it.") and report.verdict.use in head
    assert "Green, amber and red" in head


def test_an_entrance_pupil_is_explained_where_it_is_clearest(report):
    chosen = next(one for one in report.models if one.chosen)
    theta = np.radians([0.0, 30.0, 75.0])
    curve = replace(chosen, theta=theta, pupil=np.array([0, -5e-4, -3.1e-3]), pupil_sigma=np.array([0, 4e-4, 9e-4]))
    told = replace(report, models=(curve,)).pupil_explained
    assert "Rays 75° off the axis enter 3.1 ± 0.9 mm nearer to the scene." in told
    assert "through one point" in replace(report, models=(replace(curve, pupil=np.zeros(3)),)).pupil_explained


def test_figures_and_pictures_have_alternative_text(page):
    figures = [found for _, found in page.tags if found.get("role") == "img"]
    assert len(figures) >= 10 and all(len(found["aria-label"]) > 40 for found in figures)
    assert all(found["alt"] for tag, found in page.tags if tag == "img")
