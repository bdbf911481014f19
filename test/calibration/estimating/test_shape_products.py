"""Products with a target's shape against those of its columns written out."""

from types import SimpleNamespace

import numpy as np
import pytest

from fisheye_ep_calib.calibration.estimating.shape_products import ShapeProducts
from fisheye_ep_calib.calibration.estimating.views import ViewBlock

POINTS, SMOOTH, VIEWS, OWN, SHARED = 12, 4, 3, 6, 5


@pytest.mark.parametrize("faces", [False, True])
def test_products_are_those_of_the_columns(faces):
    rng = np.random.default_rng(3)
    axes = np.linalg.qr(rng.normal(size=(POINTS, 3, 3)))[0]
    axes = axes if faces else np.tile(axes[0], (POINTS, 1, 1))
    fields = rng.normal(size=(POINTS, 9, SMOOTH))
    shape = SimpleNamespace(
        nominal=np.zeros((POINTS, 3)),
        fields=fields,
        smooth_size=SMOOTH,
        rough_size=3 * POINTS,
        size=SMOOTH + 3 * POINTS,
        point_axes=axes,
    )
    points = np.stack([rng.permutation(POINTS)[:9] for _ in range(VIEWS)])
    real = np.arange(9) < np.array([9, 7, 8])[:, None]  # the rest is padding
    block = ViewBlock(np.arange(VIEWS), points, real, points, *np.zeros((3, 1)))
    d_local, own, shared, error = (rng.normal(size=(2, count, VIEWS, 9)) for count in (3, OWN, SHARED, 1))
    weights = np.where(real, rng.uniform(0.5, 1.0, real.shape), 0.0)

    products = ShapeProducts(shape, VIEWS, OWN, SHARED, has_discs=False)
    products.add(block, [own, shared, error], d_local, weights)
    equations = products.equations()

    columns = np.zeros((POINTS, 3, shape.size))
    columns[:, :, :SMOOTH] = fields[:, :3]
    for point in range(POINTS):
        columns[point, :, SMOOTH + 3 * point : SMOOTH + 3 * point + 3] = axes[point]
    jacobian = np.einsum("rlbn,bnlk->rkbn", d_local, columns[points])
    square = weights**2
    np.testing.assert_allclose(equations.pose, np.einsum("rqbn,bn,rkbn->bqk", own, square, jacobian), atol=1e-12)
    np.testing.assert_allclose(equations.camera, np.einsum("rpbn,bn,rkbn->pk", shared, square, jacobian), atol=1e-12)
    np.testing.assert_allclose(
        equations.gradient, np.einsum("rbn,bn,rkbn->k", error[:, 0], square, jacobian), atol=1e-12
    )
    whole = np.einsum("rjbn,bn,rkbn->jk", jacobian, square, jacobian)
    np.testing.assert_allclose(equations.smooth, whole[:SMOOTH], atol=1e-12)
    for point in range(POINTS):
        place = slice(SMOOTH + 3 * point, SMOOTH + 3 * point + 3)
        np.testing.assert_allclose(equations.rough[point], whole[place, place], atol=1e-12)
