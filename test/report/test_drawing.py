"""What the page's figures are drawn with: scales, fields of colours, marks at their places."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pytest

from fisheye_ep_calib.report.drawing import PageAxes, page_figure, raster
from fisheye_ep_calib.report.drawing.colours import Colouring, colour_table
from fisheye_ep_calib.report.drawing.scales import Scale, linear_ticks, log_ticks, plain_numbers

SIZE = (40, 60)


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (0, 93, 5, [0, 20, 40, 60, 80]),
        (-2.6, 0.1, 6, [-2.5, -2, -1.5, -1, -0.5, 0]),
        (0.061, 0.144, 5, [0.08, 0.1, 0.12, 0.14]),
    ],
)
def test_ticks_are_round_numbers_within_the_limits(low, high, most, expected):
    np.testing.assert_allclose(linear_ticks(low, high, most), expected, atol=1e-12)


def test_numbers_have_the_decimals_that_tell_them_apart():
    assert plain_numbers(np.array([-0.5, 0.0, 0.25])) == ["−0.50", "0.00", "0.25"]
    assert plain_numbers(np.array([0.0, 200.0])) == ["0", "200"]
    assert {1.0, 2.0, 5.0} <= set(log_ticks(0.8, 7.0)) and list(log_ticks(0.005, 20)) == [0.01, 0.1, 1, 10]


def test_a_scale_takes_limits_or_what_was_seen_with_a_margin():
    scale = Scale()
    scale.see(np.array([2.0, np.nan, 4.0]))
    assert scale.limits() == pytest.approx((1.9, 4.1))
    scale.low = 0.0
    assert scale.place(np.array([0.0, scale.limits()[1]])) == pytest.approx([0, 1])
    logarithmic = Scale(low=0.1, high=10, logarithmic=True, reversed=True)
    assert logarithmic.place(np.array([10.0, 1.0, 0.1])) == pytest.approx([0, 0.5, 1])


def plane(places: np.ndarray) -> np.ndarray:
    return 0.5 * places[..., 0] - 0.2 * places[..., 1] + 3


def test_a_field_between_points_is_that_of_a_plane():
    rng = np.random.default_rng(3)
    places = np.concatenate([rng.uniform(4, 36, (80, 2)), [[2, 2], [38, 2], [2, 38], [38, 38]]])
    field = raster.triangle_field(places, plane(places), SIZE)
    there = np.argwhere(np.isfinite(field))
    np.testing.assert_allclose(field[tuple(there.T)], plane(there[:, ::-1]), atol=0.8)
    assert np.isfinite(field[5:35, 5:35]).all() and np.isnan(field[:, 45:]).all()


def test_a_field_between_nodes_has_no_holes_and_its_gaps_stay():
    x, y = np.meshgrid(np.linspace(5, 50, 4), np.linspace(5, 30, 5))
    places = np.stack([x, y], axis=-1)
    values = plane(places)
    field = raster.grid_field(places, values, SIZE)
    there = np.argwhere(np.isfinite(field))
    assert np.isfinite(field[6:30, 6:50]).all()
    np.testing.assert_allclose(field[tuple(there.T)], plane(there[:, ::-1]), atol=0.4)
    values[0, 0] = np.nan
    assert np.isnan(raster.grid_field(places, values, SIZE)[6, 7])


def test_each_place_has_the_value_of_its_cell():
    values = np.array([[1.0, 2.0], [3.0, np.nan]])
    edges = np.array([0.0, 1.0, 2.0])
    found = raster.cells(np.array([0.5, 1.5, 0.5, 1.5, 2.5]), np.array([0.5, 0.5, 1.5, 1.5, 0.5]), edges, edges, values)
    np.testing.assert_array_equal(found, [1, 2, 3, np.nan, np.nan])


def test_dots_on_one_another_cover_more():
    places = np.array([[10.0, 10.0], [10.0, 10.0], [30.0, 20.0], [np.nan, 5.0], [500.0, 5.0]])
    alpha = raster.dots(places, SIZE, 1.5, "#ff0000", 0.5)[..., 3] / 255
    assert alpha[10, 10] == pytest.approx(0.75, abs=0.01) and alpha[20, 30] == pytest.approx(0.5, abs=0.01)
    assert alpha[30:].max() == 0


def test_colours_run_from_low_to_high_and_in_steps():
    colouring = Colouring("viridis", 1, 100, logarithmic=True)
    np.testing.assert_array_equal(colouring.rgb(np.array([1.0, 100.0])), colour_table("viridis")[[0, 255]])
    steps = Colouring("RdYlBu_r", 0, 3, levels=(0.0, 1.0, 2.0, 3.0)).rgb(np.array([0.1, 0.9, 1.1, 2.9, 7.0]))
    assert (steps[0] == steps[1]).all() and (steps[1] != steps[2]).any() and (steps[2] != steps[3]).any()


def test_marks_stand_where_their_data_are_and_labels_are_escaped():
    axes = PageAxes()
    axes.plot([0, 10], [0, 10], "o", ms=4, color="#123456", label="a < b")
    axes.set(xlabel="x & y", ylabel="z", xlim=(0, 10), ylim=(0, 10))
    axes.legend()
    drawn = page_figure(axes, "one", (4.0, 3.0))
    assert "a &lt; b" in drawn and "x &amp; y" in drawn
    frame = re.search(r'clipPath id="one-clip"><rect x="(.*?)" y="(.*?)" width="(.*?)" height="(.*?)"', drawn)
    left, top, width, height = map(float, frame.groups())
    first, last = re.findall(r"M([\d.]+) ([\d.]+)a2 2", drawn)[:2]
    assert np.array(first, float) == pytest.approx([left, top + height - 2], abs=0.03)
    assert np.array(last, float) == pytest.approx([left + width - 4, top + 2], abs=0.03)
    assert 0 < left < left + width < 4 * 72 and 0 < top < top + height < 3 * 72


def test_a_page_is_made_without_matplotlib():
    modules = (
        "fisheye_ep_calib.report.html, fisheye_ep_calib.report.from_calibration, fisheye_ep_calib.report.comparison"
    )
    code = f"import sys, {modules}; sys.exit('matplotlib' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
