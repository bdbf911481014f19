"""Cameras written down a second time, and points made from rays: truth that needs no solver.

A point on the ray of angle θ at distance D from its pupil is (D sinθ cosφ, D sinθ sinφ, D cosθ − E(θ)).
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera

PUPILS = {
    "kannala": lambda theta, c: 0.0 * theta,
    "ep_odd": lambda theta, c: sum(e * theta ** (3 + 2 * i) for i, e in enumerate(c)),
    "ep_even": lambda theta, c: sum(e * theta ** (2 + 2 * i) for i, e in enumerate(c)),
    "gennery": lambda theta, c: -(theta / np.sin(theta) - 1) * sum(g * theta ** (2 * i) for i, g in enumerate(c)),
}
TERMS = {"kannala": 0, "ep_odd": 4, "ep_even": 2, "gennery": 3}


def kannala_brandt(theta, k):
    return theta + sum(value * theta ** (2 * term + 3) for term, value in enumerate(k))


def double_sphere(theta, k):
    """Usenko, Demmel and Cremers (2018), equation 40, for the unit ray (sinθ, 0, cosθ)."""
    xi, alpha = k
    d2 = np.sqrt(np.sin(theta) ** 2 + (xi + np.cos(theta)) ** 2)
    return np.sin(theta) / (alpha * d2 + (1 - alpha) * (xi + np.cos(theta)))


LENSES = {"kannala_brandt": kannala_brandt, "kannala_brandt_6": kannala_brandt, "double_sphere": double_sphere}


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


def random_camera(rng, model: str, lens: str = "kannala_brandt", extras: tuple[str, ...] = ()) -> FisheyeCamera:
    """A camera of up to 100° and pupil shifts of up to 17 mm toward the scene, or 5 mm away from it, at 90°."""
    right_angle = np.array(np.pi / 2)
    terms = TERMS[model]
    shares = rng.dirichlet(np.ones(terms)) * rng.uniform(-17e-3, 5e-3) if terms else ()
    units = np.eye(terms)
    coefficients = [float(share / PUPILS[model](right_angle, unit)) for share, unit in zip(shares, units, strict=True)]
    radial = rng.normal(0, [0.015, 0.004, 0.001, 0.0002])
    if lens == "kannala_brandt_6":
        radial = [*radial, *rng.uniform(0, [4e-5, 8e-6])]
    if lens == "double_sphere":
        radial = [rng.uniform(-0.35, 0.0), rng.uniform(0.55, 0.65)]
    return FisheyeCamera(
        image_size=(2048, 1536),
        fx=rng.uniform(300, 800),
        fy=rng.uniform(300, 800),
        skew=rng.uniform(-2, 2),
        cx=1023 + rng.uniform(-50, 50),
        cy=767 + rng.uniform(-50, 50),
        radial=tuple(map(float, radial)),
        model=model,
        coefficients=tuple(coefficients),
        extras={name: tuple(rng.uniform(-0.01, 0.01, 2)) for name in extras},
        lens=lens,
        theta_max=np.radians(101),
    )


def true_pupil(camera: FisheyeCamera, theta) -> np.ndarray:
    """E(θ), metres, θ > 0."""
    return np.asarray(PUPILS[camera.model](theta, camera.coefficients))


def caustic_distance(camera: FisheyeCamera, theta, step: float = 1e-5) -> np.ndarray:
    """−E′(θ) sinθ, metres, E′ by central differences: the least distance from the pupil."""
    slope = (true_pupil(camera, theta + step) - true_pupil(camera, theta - step)) / (2 * step)
    return -slope * np.sin(theta)


def true_pixels(camera: FisheyeCamera, theta, phi) -> np.ndarray:
    """Pixels (n, 2) of rays at angles θ, φ (n,)."""
    radius = LENSES[camera.lens](theta, camera.radial)
    x, y = radius * np.cos(phi), radius * np.sin(phi)
    if "tangential" in camera.extras:
        x, y = decentered(x, y, camera.extras["tangential"])
    if "tilt" in camera.extras:
        x, y = tilted(x, y, camera.extras["tilt"])
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
