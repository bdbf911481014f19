"""The detectors' parts: lattices, labels, corner and disc measurement."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.special import erf, ndtr

from fisheye_ep_calib.target.cells import extrapolate, line_residuals
from fisheye_ep_calib.target.corners.saddle_fit import fit_saddles
from fisheye_ep_calib.target.discs.lattice import grow_lattices
from fisheye_ep_calib.target.discs.lattice_evidence import fits_neighbours, is_disc_lattice, is_every_second
from fisheye_ep_calib.target.discs.measurement import measure_discs
from fisheye_ep_calib.target.labelling import label_patch
from fisheye_ep_calib.target.markers.marker_board import local_quadratics


def grid(columns: int, rows: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)


def bent(cells: np.ndarray) -> np.ndarray:
    """A smooth, strongly bent map of the lattice, a fisheye's kind."""
    x, y = cells.T * 30.0
    return np.stack([400 + x - 4e-4 * x * y, 300 + 0.7 * y + 0.2 * x + 3e-4 * y * y], axis=-1)


def test_a_bent_sheared_lattice_is_grown_whole():
    cells = grid(9, 6)
    step = 1e-4
    jacobian = np.stack(
        [(bent(cells + [step, 0]) - bent(cells)) / step, (bent(cells + [0, step]) - bent(cells)) / step], axis=-1
    )
    shape = jacobian @ np.swapaxes(jacobian, 1, 2) / 9
    clutter = np.random.default_rng(0).uniform(200, 900, (200, 2))
    apart = np.linalg.norm(clutter[:, None] - bent(cells), axis=-1).min(axis=1) > 60
    clutter = clutter[apart][:60]
    center = np.concatenate([bent(cells), clutter])
    shape = np.concatenate([shape, np.repeat(shape[:1], len(clutter), axis=0)])
    for ratio in (3.0, None):
        lattice = grow_lattices(center, shape, ratio)[0]
        own = lattice.blob < 54
        assert own.sum() == 54
        design = np.column_stack([lattice.cell[own], np.ones(54)])
        fit, rest, *_ = np.linalg.lstsq(design, cells[lattice.blob[own]].astype(float), rcond=None)
        assert np.abs(design @ fit - cells[lattice.blob[own]]).max() < 1e-9


@pytest.mark.parametrize("ratio", [2.6, None])
def test_a_lattice_whose_scale_halves_within_two_steps_is_grown_whole(ratio):
    cells = grid(4, 3)
    x, y = cells.T.astype(float)
    depth = 1 / (1 + 0.33 * x + 0.1 * y)  # a board seen steeply by a camera without distortion
    center = 500 * depth[:, None] * np.stack([x - 2, y - 1], axis=-1)
    along = np.stack([[1.66 + 0.1 * y, -(0.1 * (x - 2))], [-0.33 * (y - 1), 1.1 + 0.33 * x]])
    jacobian = 500 * depth[:, None, None] ** 2 * np.moveaxis(along, -1, 0)
    lattice = grow_lattices(center, jacobian @ np.swapaxes(jacobian, 1, 2) / 2.6**2, ratio)[0]
    assert len(lattice) == 12


@pytest.mark.parametrize("turn", range(4))
def test_labels_survive_turning_and_shifting(turn):
    lattice = grid(6, 4)
    cells = lattice.copy()
    for _ in range(turn):
        cells = cells @ np.array([[0, 1], [-1, 0]])
    labels = label_patch(cells + [13, -5], bent(lattice), lattice)
    expected = np.arange(24)
    assert np.array_equal(labels.point_index, expected) or np.array_equal(labels.point_index, expected[::-1])


def test_marks_settle_what_is_ambiguous():
    lattice = grid(6, 4)
    part = lattice[lattice[:, 0] < 4]

    def marked(placement):
        return 1.0 if (placement(np.array([[1, 1]])) == [3, 2]).all() else 0.0

    labels = label_patch(part, bent(part), lattice, allowed=marked)
    mark = int(np.flatnonzero((part == [1, 1]).all(axis=1))[0])
    assert np.array_equal(lattice[labels.point_index[mark]], [3, 2])


def test_plain_board_beside_the_patch_settles_a_shift():
    lattice = grid(6, 4)
    part = lattice[lattice[:, 0] < 4]
    left = bent(part)[:, 0].min()
    labels = label_patch(part, bent(part), lattice, is_plain=lambda sites, scale: sites[:, 0] < left)
    assert np.array_equal(lattice[labels.point_index[0]], [0, 0])


def test_points_off_their_line_stand_out():
    cells = grid(7, 7)
    pixels = bent(cells)
    assert np.nanmax(line_residuals(cells, pixels)) < 0.05
    pixels[24] += [1.5, 1.0]
    assert np.nanargmax(line_residuals(cells, pixels)) == 24


@pytest.mark.parametrize("ahead", [1, 2])
def test_extrapolation_follows_the_bend(ahead):
    cells = grid(5, 5)
    sites, where, _ = extrapolate(cells, bent(cells), ahead)
    assert len(sites) == 20 * ahead
    np.testing.assert_allclose(where, bent(sites), atol=1e-9)


def test_local_quadratics_are_exact_for_quadratics():
    known = np.random.default_rng(0).uniform(0, 0.1, (60, 2))

    def quadratic(p):
        return np.stack([3 + 900 * p[:, 0] + 800 * p[:, 0] * p[:, 1], 5 - 700 * p[:, 1] + 600 * p[:, 1] ** 2], -1)

    wanted = np.array([[0.03, 0.05], [0.07, 0.02]])
    value, jacobian, second = local_quadratics(known, quadratic(known), wanted)
    np.testing.assert_allclose(value, quadratic(wanted), atol=1e-3)
    np.testing.assert_allclose(jacobian[0], [[900 + 40, 24], [0, -700 + 60]], atol=0.5)
    np.testing.assert_allclose(second[0], [[0, 800, 0], [0, 0, 1200]], atol=20)


def drawn_corner(place, axes, size=81, blur=1.2) -> np.ndarray:
    """A blurred saddle corner at a sub-pixel place: the product of two blurred edges."""
    u, v = np.meshgrid(np.arange(size, dtype=float), np.arange(size, dtype=float))
    s, t = np.einsum("ij,jhw->ihw", np.linalg.inv(axes), np.stack([u - place[0], v - place[1]]))
    area = abs(np.linalg.det(axes))
    across = erf(s * area / np.hypot(*axes[:, 1]) / (np.sqrt(2) * blur))
    along = erf(t * area / np.hypot(*axes[:, 0]) / (np.sqrt(2) * blur))
    return np.clip(np.rint(125 + 95 * across * along), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("axes", [np.diag([14.0, 14.0]), np.array([[15.0, 6.0], [-4.0, 9.0]]), np.diag([12.0, 5.0])])
def test_a_corner_is_fitted_to_hundredths_of_a_pixel(axes):
    rng = np.random.default_rng(2)
    for place in rng.uniform(38, 42, (5, 2)):
        fit = fit_saddles(drawn_corner(place, axes), place[None] + rng.uniform(-0.8, 0.8, 2), axes[None])
        assert fit.good(np.ones(1))[0]
        assert np.hypot(*(fit.pixels[0] - place)) < 0.03


def test_a_marker_beside_the_corner_does_not_pull_it():
    axes = np.diag([20.0, 20.0])
    place = np.array([40.3, 39.8])
    image = drawn_corner(place, axes)
    image[48:60, 48:60] = 30
    fit = fit_saddles(image, place[None], axes[None], depth=np.array([[0.35, 1.0]]))
    assert np.hypot(*(fit.pixels[0] - place)) < 0.03


def test_a_corner_with_nothing_to_see_is_no_error():
    image = np.full((60, 60), 90, np.uint8)
    for axes in (np.diag([1.0, 1.0]), np.diag([20.0, 0.3]), np.zeros((2, 2)), np.array([[5.0, 5.0], [5.0, 5.0]])):
        for depth in (1.0, 0.3, 0.02):
            limits = np.full((1, 2), depth), np.array([0.02])
            fit = fit_saddles(image, np.array([[30.0, 30.0]]), axes[None], None, *limits)
            assert not fit.good(np.ones(1))[0]


@pytest.mark.parametrize("blur, begins", [(1.2, 3.5), (1.2, 5.0), (1.8, 5.0), (1.8, 7.0)])
def test_a_markers_blur_stays_out_of_the_fit(blur, begins):
    """A marker in one quadrant, ``begins`` pixels from both edges of the corner; the mean shift of 20 corners."""
    axes, errors = np.diag([20.0, 20.0]), []
    for place in np.random.default_rng(0).uniform(39, 41, (20, 2)):
        u, v = np.meshgrid(np.arange(81.0) - place[0], np.arange(81.0) - place[1])
        marker = ndtr((u - begins) / blur) * ndtr((v - begins) / blur)
        picture = 125 + 95 * erf(u / (np.sqrt(2) * blur)) * erf(v / (np.sqrt(2) * blur)) - 190 * marker
        image = np.rint(picture).clip(0, 255).astype(np.uint8)
        fit = fit_saddles(image, place[None] + [0.4, -0.3], axes[None], depth=np.array([[begins / 20, 1.0]]))
        errors.append(fit.pixels[0] - place)
    assert np.abs(np.mean(errors, axis=0)).max() < 0.015


@pytest.mark.parametrize("radii", [(4.0, 3.2), (12.0, 7.0), (40.0, 35.0)])
@pytest.mark.parametrize("hole", [0.0, 0.4])
def test_a_disc_is_measured_where_it_is(radii, hole):
    if hole and min(radii) < 5:
        pytest.skip("the hole of so small a disc cannot be seen")
    size, factor = int(6 * max(radii)), 8
    place = np.array([size / 2 + 0.31, size / 2 - 0.17])
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    shape = turn @ np.diag(np.square(radii)) @ turn.T
    fine = (np.arange(size * factor) + 0.5) / factor - 0.5
    u, v = np.meshgrid(fine - place[0], fine - place[1])
    inverse = np.linalg.inv(shape)
    distance = inverse[0, 0] * u * u + 2 * inverse[0, 1] * u * v + inverse[1, 1] * v * v
    picture = np.where((distance < 1) & (distance >= hole**2), 25.0, 200.0) * (1 + 0.2 * u / size)
    image = cv2.GaussianBlur(picture.reshape(size, factor, size, factor).mean(axis=(1, 3)), (0, 0), 0.9)
    image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    found = measure_discs(image, place[None] + [0.6, -0.4], shape[None] * 1.05, 3.0, np.array([hole]))
    assert found.good[0]
    assert np.hypot(*(found.center[0] - place)) < 0.03
    assert found.blur[0] == pytest.approx(0.9, abs=0.25)


def test_a_diagonal_part_of_a_lattice_is_known_as_one():
    cells = grid(9, 7)
    part = cells[cells.sum(axis=1) % 2 == 0]
    turned = np.stack([(part[:, 0] + part[:, 1]) // 2, (part[:, 1] - part[:, 0]) // 2], axis=-1)
    assert is_every_second(turned, bent(part), bent(cells))
    assert not is_every_second(cells, bent(cells), bent(cells))


def test_discs_are_rulers_of_their_lattice():
    cells = grid(8, 6)
    step = 1e-4
    sides = [(bent(cells + side) - bent(cells)) / step for side in ([step, 0], [0, step])]
    jacobian = np.stack(sides, axis=-1)
    shape = jacobian @ np.swapaxes(jacobian, 1, 2) / 9
    assert is_disc_lattice(cells, bent(cells), shape, ratio=3.0)
    assert is_disc_lattice(cells, bent(cells), shape, ratio=None)
    assert not is_disc_lattice(cells, bent(cells), shape, ratio=3.0 * np.sqrt(2))
    line = cells[:, 1] == 0
    assert not is_disc_lattice(cells[line], bent(cells[line]), shape[line], ratio=3.0)
    center = bent(cells)
    center[20] = center[21] + 0.5
    wrong = ~fits_neighbours(cells, center, shape)
    assert wrong[20] and wrong.sum() <= 2


def test_one_whole_square_is_enough_where_all_rulers_agree():
    # Three rows of an asymmetric grid at the image's border: (x, y) with x + y even, along the diagonals.
    x, y = np.array([[1, 3, 5, 7, 9, 0, 2, 4, 6, 8, 7], [0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 2]])
    cells = np.stack([(x + y) // 2, (y - x) // 2], axis=-1)
    center = 30.0 * np.stack([x, y], axis=-1)
    radius = np.full(len(cells), 30 * np.sqrt(2) / 3)
    assert is_disc_lattice(cells, center, radius[:, None, None] ** 2 * np.eye(2), ratio=3.0)
    radius[::3] *= 1.15
    assert not is_disc_lattice(cells, center, radius[:, None, None] ** 2 * np.eye(2), ratio=3.0)
    chain = y < 2
    assert not is_disc_lattice(cells[chain], center[chain], radius[chain, None, None] ** 2 * np.eye(2), ratio=3.0)
