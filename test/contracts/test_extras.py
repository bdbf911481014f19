"""What every lens extra promises: a map of the image plane near the identity, with its derivatives and its inverse."""

from __future__ import annotations

import numpy as np
import pytest
from differences import central_differences

from fisheye_ep_calib.camera import LENS_EXTRAS, LENSES

REACH = 1.7  # what a fisheye of about 100° sees, in the plane's unit


@pytest.fixture
def extra(extra_name):
    return LENS_EXTRAS[extra_name]


@pytest.fixture
def coefficients(extra) -> list[np.ndarray]:
    rng = np.random.default_rng(4)
    count = len(extra.coefficient_names)
    return [np.zeros(count), *(rng.uniform(-size, size, count) for size in (1e-9, 0.01, 0.02))]


def plane(shape, reach: float = REACH) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.random.default_rng(5).uniform(-reach, reach, (2, *shape))
    return np.array(x), np.array(y)


def test_it_goes_by_its_own_name(extra, extra_name) -> None:
    assert extra.name == extra_name and extra_name.isidentifier()
    assert extra_name not in ("model", "lens", "skew", "terms", "target", "pixels", "radial", "coefficients")


def test_each_coefficient_has_a_name_of_its_own(extra, extra_name) -> None:
    names = extra.coefficient_names
    assert len(set(names)) == len(names) > 0
    others = {"fx", "fy", "skew", "cx", "cy"}
    others |= {name for lens in LENSES.values() for name in lens.coefficient_names}
    others |= {name for key, other in LENS_EXTRAS.items() if key != extra_name for name in other.coefficient_names}
    assert not others & set(names)
    assert not [name for name in names if name[0] == "e" and name[1:].isdigit()], "a pupil's names"


def test_shapes(extra, coefficients, shape) -> None:
    x, y = plane(shape)
    x.flags.writeable = y.flags.writeable = False
    for values in coefficients:
        assert [np.shape(part) for part in extra.apply(x, y, values)] == [shape] * 2
        assert [np.shape(part) for part in extra.invert(x, y, values)] == [shape] * 3
        by_place, by_coefficient = extra.jacobian(x, y, tuple(values))
        assert by_coefficient.shape == (2, len(values), *shape)
        for part in (by_place.xx, by_place.xy, by_place.yx, by_place.yy):
            assert np.broadcast_shapes(np.shape(part), shape) == shape


def test_zeros_leave_everything_where_it_is(extra) -> None:
    x, y = plane((30, 20))
    none = (0.0,) * len(extra.coefficient_names)
    assert all(np.array_equal(a, b) for a, b in zip(extra.apply(x, y, none), (x, y), strict=True))
    back_x, back_y, valid = extra.invert(x, y, none)
    assert np.all(valid)
    np.testing.assert_allclose([back_x, back_y], [x, y], atol=1e-14)


def test_the_derivative_by_place(extra, coefficients) -> None:
    places = np.stack(plane((200,)), axis=-1)
    for values in coefficients:
        numeric = central_differences(
            lambda at, values=values: np.stack(extra.apply(at[:, 0], at[:, 1], values), axis=-1),
            places,
            np.full(places.shape, 1e-3),
        )
        found, _ = extra.jacobian(places[:, 0], places[:, 1], values)
        for name, row, column in (("xx", 0, 0), ("xy", 0, 1), ("yx", 1, 0), ("yy", 1, 1)):
            entry = np.broadcast_to(getattr(found, name), 200)
            np.testing.assert_allclose(entry, numeric[:, row, column], rtol=1e-8, atol=1e-10, err_msg=name)


def test_the_derivative_by_each_coefficient(extra, coefficients) -> None:
    x, y = plane((200,))
    for values in coefficients:
        _, found = extra.jacobian(x, y, values)
        numeric = central_differences(
            lambda moved: np.stack(extra.apply(x, y, moved)), values, np.full(len(values), 1e-4)
        )
        for number, name in enumerate(extra.coefficient_names):
            expected = numeric[..., number]
            assert np.abs(expected).max() > 1e-3, f"{name} does nothing"
            np.testing.assert_allclose(found[:, number], expected, rtol=1e-7, atol=1e-9, err_msg=name)


def test_the_inverse_leads_back(extra, coefficients) -> None:
    x, y = plane((30, 20))
    for values in coefficients:
        back_x, back_y, valid = extra.invert(*extra.apply(x, y, values), values)
        assert np.all(valid)
        np.testing.assert_allclose([back_x, back_y], [x, y], atol=1e-11)


def test_far_away_the_inverse_is_right_or_says_that_there_is_none(extra) -> None:
    x, y = plane((40, 40), reach=60.0)
    values = np.full(len(extra.coefficient_names), 0.03)
    back_x, back_y, valid = extra.invert(x, y, values)
    again = np.stack(extra.apply(back_x[valid], back_y[valid], values))
    assert valid.any()
    np.testing.assert_allclose(again, [x[valid], y[valid]], rtol=1e-7, atol=1e-7)
