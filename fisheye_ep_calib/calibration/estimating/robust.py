"""Robust losses: how much a residual counts, as a function of its squared length in units of its scale."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Loss:
    """kind "linear", "huber" or "cauchy"; scale: where a weighted residual stops counting fully, in its unit."""

    kind: str = "linear"
    scale: float = 1.0

    def evaluate(self, square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ρ and √ρ′ of squared lengths of weighted residuals, of the same shape.

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

    def curvature(self, square: np.ndarray) -> np.ndarray:
        """½ div ψ of the influence ψ(v) = ρ′(|v|²) v of residuals v of these squared lengths: ρ′ + s ρ″."""
        if self.kind == "linear":
            return np.ones_like(square)
        limit = self.scale**2
        if self.kind == "cauchy":
            return (1 + square / limit) ** -2
        return np.where(square > limit, 0.5 * self.scale / np.sqrt(np.maximum(square, limit)), 1.0)


LINEAR = Loss()


def noise_variance(loss: Loss, square: np.ndarray, degrees_of_freedom: int) -> tuple[float, float]:
    """σ², px², of one coordinate, and by how much the loss lowers the information JᵀJ, from squared lengths (n,).

    σ² = K² Σ |ψ|² / degrees of freedom / (mean ψ′)², ψ′ = ½ div ψ, K = 1 + p/n var ψ′ / (mean ψ′)² for p parameters
    of n coordinates: with it σ² (JᵀJ)⁻¹ is the covariance of the estimate (Huber, Robust Statistics, 1981, 7.6).
    Without a robust loss it is the usual sum of squares over the degrees of freedom. The normal equations hold JᵀJ
    times mean ρ′, the second figure.
    """
    _, factor = loss.evaluate(square)
    weight = factor**2
    influence = float((weight**2 * square).sum()) / max(degrees_of_freedom, 1)
    curvature = loss.curvature(square)
    parameters = 1 - degrees_of_freedom / (2 * len(square))
    inflation = 1 + parameters * float(curvature.var() / curvature.mean() ** 2)
    return inflation**2 * influence / float(curvature.mean()) ** 2, float(weight.mean())


def robust_spread(lengths: np.ndarray, quantile: float = 0.5) -> float:
    """Standard deviation per axis, px, from a quantile q of residual lengths: σ √(−2 ln(1 − q)) (Rayleigh)."""
    if len(lengths) == 0:
        return 0.0
    return float(np.quantile(lengths, quantile) / np.sqrt(-2 * np.log1p(-quantile)))
