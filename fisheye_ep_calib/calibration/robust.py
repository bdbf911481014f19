"""Robust losses: how much a residual counts, as a function of its squared length in units of its scale."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Loss:
    """kind "linear", "huber" or "cauchy"; scale in pixels: where a residual stops counting fully."""

    kind: str = "linear"
    scale: float = 1.0

    def evaluate(self, square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ρ and √ρ′ of squared residual lengths (px²), of the same shape.

        huber: ρ = s for s ≤ c², 2 c √s − c² beyond; cauchy: ρ = c² ln(1 + s/c²).
        """
        if self.kind == "linear":
            return square, np.ones_like(square)
        limit = self.scale**2
        if self.kind == "cauchy":
            ratio = square / limit
            return limit * np.log1p(ratio), 1 / np.sqrt(1 + ratio)
        length = np.sqrt(np.maximum(square, limit))
        outside = square > limit
        value = np.where(outside, 2 * self.scale * length - limit, square)
        return value, np.where(outside, np.sqrt(self.scale / length), 1.0)


LINEAR = Loss()


def robust_spread(lengths: np.ndarray, quantile: float = 0.5) -> float:
    """Standard deviation per axis, px, from a quantile q of residual lengths: σ √(−2 ln(1 − q)) (Rayleigh)."""
    if len(lengths) == 0:
        return 0.0
    return float(np.quantile(lengths, quantile) / np.sqrt(-2 * np.log1p(-quantile)))
