"""Cameras written down a second time, and points made from rays: truth that needs no solver.

A point on the ray of angle θ at distance D from its pupil is (D sinθ cosφ, D sinθ sinφ, D cosθ − E(θ)).
Every registered part takes part; one that is not written down here answers for its own values, and its derivatives
are held against those.
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.camera import LENS_EXTRAS, LENSES, PUPIL_FAMILIES, FisheyeCamera

TERMS = {name: family.max_terms for name, family in PUPIL_FAMILIES.items()}
EXTRAS = list(dict.fromkeys([(), *((name,) for name in LENS_EXTRAS), tuple(LENS_EXTRAS)]))
KINDS = [(model, lens, extras) for model in PUPIL_FAMILIES for lens in LENSES for extras in EXTRAS]

PUPIL_FORMULAS = {
    "kannala": lambda theta, c: 0.0 * theta,
    "ep_odd": lambda theta, c: sum(e * theta ** (3 + 2 * i) for i, e in enumerate(c)),
    "ep_even": lambda theta, c: sum(e * theta ** (2 + 2 * i) for i, e in enumerate(c)),
    "gennery": lambda theta, c: -(theta / np.sin(theta) - 1) * sum(g * theta ** (2 * i) for i, g in enumerate(c)),
}


def kannala_brandt(theta, k):
    return theta + sum(value * theta ** (2 * term + 3) for term, value in enumerate(k))


def double_sphere(theta, k):
    """Usenko, Demmel and Cremers (2018), equation 40, for the unit ray (sinθ, 0, cosθ)."""
    xi, alpha = k
    d2 = np.sqrt(np.sin(theta) ** 2 + (xi + np.cos(theta)) ** 2)
    return np.sin(theta) / (alpha * d2 + (1 - alpha) * (xi + np.cos(theta)))


LENS_FORMULAS = {"kannala_brandt": kannala_brandt, "kannala_brandt_6": kannala_brandt, "double_sphere": double_sphere}


def decentered(x, y, p):
    square = x * x + y * y
    return x + 2 * p[0] * x * y + p[1] * (square + 2 * x * x), y + p[0] * (square + 2 * y * y) + 2 * p[1] * x * y


def tilted(x, y, tau):
    """OpenCV's tilted sensor, from the formula in its documentation."""
    (cx, cy), (sx, sy) = np.cos(tau), np.sin(tau)
    rotation = np.array([[cy, sy * sx, -sy * cx], [0, cx, sx], [sy, -cy * sx, cy * cx]])
    projector = np.array([[rotation[2, 2], 0, -rotation[0, 2]], [0, rotation[2, 2], -rotation[1, 2]], [0, 0, 1]])
    a, b, c = np.einsum("ij,j...->i...", projector @ rotation, np.stack([x, y, np.ones_like(x)]))
    return a / c, b / c


EXTRA_FORMULAS = {"tangential": decentered, "tilt": tilted}


def pupil(model: str, theta, coefficients) -> np.ndarray:
    """E(θ), metres, θ > 0."""
    if model in PUPIL_FORMULAS:
        return np.asarray(PUPIL_FORMULAS[model](theta, coefficients))
    basis = PUPIL_FAMILIES[model].basis(np.asarray(theta, dtype=float), len(coefficients))
    return np.tensordot(np.asarray(coefficients), basis, axes=1)


def lens_radius(name: str, theta, coefficients) -> np.ndarray:
    """r(θ)."""
    if name in LENS_FORMULAS:
        return np.asarray(LENS_FORMULAS[name](theta, coefficients))
    return LENSES[name].radius(np.asarray(theta, dtype=float), np.asarray(coefficients))


def random_lens(rng, name: str) -> list[float]:
    """Coefficients of a lens, some way from where a calibration starts."""
    if name.startswith("kannala_brandt"):
        more = rng.uniform(0, [4e-5, 8e-6]) if name == "kannala_brandt_6" else []
        return [*rng.normal(0, [0.015, 0.004, 0.001, 0.0002]), *more]
    if name == "double_sphere":
        return [rng.uniform(-0.35, 0.0), rng.uniform(0.55, 0.65)]
    start = np.array(LENSES[name].start_coefficients, dtype=float)
    return list(start + rng.uniform(-0.02, 0.02, len(start)) / effect_of_coefficients(name, start))


def effect_of_coefficients(name: str, coefficients: np.ndarray) -> np.ndarray:
    """How much r(100°) moves by each of a lens's coefficients (n,), by differences."""
    edge, step = np.array(np.radians(100)), 1e-4
    moved = [lens_radius(name, edge, coefficients + step * unit) for unit in np.eye(len(coefficients))]
    return np.abs(np.array(moved) - lens_radius(name, edge, coefficients)) / step


def random_camera(rng, model: str, lens: str = "kannala_brandt", extras: tuple[str, ...] = ()) -> FisheyeCamera:
    """A camera of up to 100° and pupil shifts of up to 17 mm toward the scene, or 5 mm away from it, at 90°."""
    right_angle = np.array(np.pi / 2)
    terms = TERMS[model]
    shares = rng.dirichlet(np.ones(terms)) * rng.uniform(-17e-3, 5e-3) if terms else ()
    units = np.eye(terms)
    coefficients = [float(share / pupil(model, right_angle, unit)) for share, unit in zip(shares, units, strict=True)]
    return FisheyeCamera(
        image_size=(2048, 1536),
        fx=rng.uniform(300, 800),
        fy=rng.uniform(300, 800),
        skew=rng.uniform(-2, 2),
        cx=1023 + rng.uniform(-50, 50),
        cy=767 + rng.uniform(-50, 50),
        radial=tuple(map(float, random_lens(rng, lens))),
        model=model,
        coefficients=tuple(coefficients),
        extras={name: tuple(rng.uniform(-0.01, 0.01, len(LENS_EXTRAS[name].coefficient_names))) for name in extras},
        lens=lens,
        theta_max=np.radians(101),
    )


def true_pupil(camera: FisheyeCamera, theta) -> np.ndarray:
    """E(θ), metres, θ > 0."""
    return pupil(camera.model, theta, camera.coefficients)


def caustic_distance(camera: FisheyeCamera, theta, step: float = 1e-5) -> np.ndarray:
    """−E′(θ) sinθ, metres, E′ by central differences: the least distance from the pupil."""
    slope = (true_pupil(camera, theta + step) - true_pupil(camera, theta - step)) / (2 * step)
    return -slope * np.sin(theta)


def true_pixels(camera: FisheyeCamera, theta, phi) -> np.ndarray:
    """Pixels (n, 2) of rays at angles θ, φ (n,)."""
    radius = lens_radius(camera.lens, theta, camera.radial)
    x, y = radius * np.cos(phi), radius * np.sin(phi)
    for name in LENS_EXTRAS:
        if name in camera.extras:
            x, y = EXTRA_FORMULAS.get(name, LENS_EXTRAS[name].apply)(x, y, camera.extras[name])
    return np.stack([camera.fx * x + camera.skew * y + camera.cx, camera.fy * y + camera.cy], axis=-1)


def ray_points(camera: FisheyeCamera, theta, phi, distance) -> np.ndarray:
    """Points (n, 3), metres, on the rays of angles θ, φ (n,) at distances (n,) from their pupils."""
    direction = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    points = distance[..., None] * direction
    points[..., 2] -= true_pupil(camera, theta)
    return points


def random_rays(rng, camera: FisheyeCamera, count: int, least: float = 0.0) -> tuple[np.ndarray, ...]:
    """θ up to 100°, φ, and distances from the pupil up to 5 m, outside the caustic of every ray by ``least`` metres."""
    theta, phi = rng.uniform(1e-3, np.radians(100), count), rng.uniform(-np.pi, np.pi, count)
    field = np.linspace(1e-3, camera.theta_max, 500)
    nearest = max(float(caustic_distance(camera, field).max()), 0.0) + least + 1e-3
    return theta, phi, nearest * (5.0 / nearest) ** rng.uniform(0, 1, count)
