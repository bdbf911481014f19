"""What a report shows, as plain data: whoever has a camera to report on fills these in."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fisheye_ep_calib.calibration.assessing.error_budget import ErrorBudget
from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.assessing.uncertainty import ProjectionTable
from fisheye_ep_calib.calibration.words import Verdict
from fisheye_ep_calib.target.shape.measured import BoardShape


@dataclass(frozen=True)
class ModelCurve:
    """A model's E(θ), metres, with its 1σ, at theta (n,) rad, and how it fits; NaN where that is unknown."""

    name: str
    theta: np.ndarray
    pupil: np.ndarray
    pupil_sigma: np.ndarray
    chosen: bool
    parameters: int = 0
    rms_px: float = float("nan")
    cross_validated_rms_px: float = float("nan")


@dataclass(frozen=True)
class LensCurve:
    """fx r(θ) and its 1σ, px, at theta (n,) rad."""

    theta: np.ndarray
    radius_px: np.ndarray
    sigma_px: np.ndarray
    focal_px: float


@dataclass(frozen=True)
class Parameter:
    """A parameter of the camera; sigma NaN where it was not estimated."""

    name: str
    value: float
    sigma: float
    unit: str


@dataclass(frozen=True)
class Residuals:
    """The sightings used, M of them. pixels, error (M, 2): measured, and predicted minus measured.

    theta, azimuth (M,): rad. distance (M,): metres from the camera. view (M,): row of ``CameraReport.views``.
    """

    pixels: np.ndarray
    error: np.ndarray
    theta: np.ndarray
    azimuth: np.ndarray
    distance: np.ndarray
    view: np.ndarray


@dataclass(frozen=True)
class Coverage:
    """counts (rings, sectors): sightings. missing, bool: the image shows the cell and it holds none.

    Cells of missing are the diagnosis's, larger than those of counts. Sector k spans 360°/sectors around azimuth
    k · 360°/sectors; ring k begins at k · ring_degrees, or missing_ring_degrees.
    """

    counts: np.ndarray
    ring_degrees: float
    missing: np.ndarray
    missing_ring_degrees: float


@dataclass(frozen=True)
class UncertaintyMap:
    """1σ in px per axis, sigma_px (angles, azimuths), at pixels (angles, azimuths, 2), for points at a distance."""

    distance_m: float
    pixels: np.ndarray
    sigma_px: np.ndarray


@dataclass(frozen=True)
class NearFar:
    """Fits to the nearer and the farther half of the views, compared at infinity by angle, px RMS a ring.

    near_m, far_m: median distances of the halves.
    """

    near_m: float
    far_m: float
    theta_deg: np.ndarray
    difference_px: np.ndarray
    expected_px: np.ndarray


@dataclass(frozen=True)
class Picture:
    """A view's image: JPEG of at most the image's size. size: (width, height) of the image itself, px."""

    jpeg: bytes
    size: tuple[int, int]


@dataclass(frozen=True)
class View:
    """distance_m: median of its points. theta_max: rad, the largest angle seen. worst_px: its largest residual."""

    name: str
    points: int
    rms_px: float
    worst_px: float
    distance_m: float
    theta_max: float
    rejected: int = 0
    picture: Picture | None = None


@dataclass(frozen=True)
class Rejected:
    """A sighting that was left out. pixel: where it was measured. residual: predicted minus measured, px."""

    view: str
    point: int
    pixel: tuple[float, float]
    residual: tuple[float, float]


@dataclass(frozen=True)
class StandInLoss:
    """distance_m: for which the stand-in was fitted. loss_px: RMS that it loses, by distance in metres."""

    distance_m: float
    loss_px: dict[float, float]


@dataclass(frozen=True)
class CameraReport:
    """One camera of a report. kind: "calibration" or "evaluation".

    unused: name of an image that is no view → why. facts: label → value, the figures at the head.
    inputs: label → value, where everything came from. reasons: how the model was chosen, a line each.
    board: the target's shape as it was found, or as it was taken; None where nothing is known of one.
    budget: where the residuals come from.
    """

    name: str
    kind: str
    image_size: tuple[int, int]
    verdict: Verdict
    findings: tuple[Finding, ...]
    facts: dict[str, str]
    models: tuple[ModelCurve, ...]
    lens: LensCurve
    parameters: tuple[Parameter, ...]
    residuals: Residuals
    coverage: Coverage
    views: tuple[View, ...]
    uncertainty_maps: tuple[UncertaintyMap, ...] = ()
    uncertainty_table: ProjectionTable | None = None
    near_far: NearFar | None = None
    stand_in: StandInLoss | None = None
    rejected: tuple[Rejected, ...] = ()
    unused: dict[str, str] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()
    board: BoardShape | None = None
    budget: ErrorBudget | None = None
    inputs: dict[str, str] = field(default_factory=dict)

    @property
    def intrinsics(self) -> tuple[Parameter, ...]:
        """What a person looks for first."""
        wanted = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
        return tuple(parameter for name in wanted for parameter in self.parameters if parameter.name == name)

    @property
    def pupil_explained(self) -> str:
        """What an entrance pupil is and what this camera's does, for who never heard of one.

        Told where E is clearest, that is at the angle at which |E| is most of its σ.
        """
        told = (
            "Light enters a fisheye through a point that slides along the lens's axis, the more the farther off the "
            "axis it comes from; E(θ) is by how much. It matters for what is close to the lens."
        )
        curve = next((model for model in self.models if model.chosen), None)
        if curve is None or not np.any(curve.pupil):
            return f"{told} In this camera all rays are taken to pass through one point."
        clear = np.abs(curve.pupil) / np.where(curve.pupil_sigma > 0, curve.pupil_sigma, np.inf)
        row = int(np.argmax(clear if clear.any() else np.abs(curve.pupil)))
        shift, sigma = 1e3 * float(curve.pupil[row]), 1e3 * float(curve.pupil_sigma[row])
        band = f" ± {sigma:.2g}" if sigma > 0 else ""
        side = "nearer to the scene" if shift < 0 else "farther from the scene"
        return f"{told} Rays {np.degrees(curve.theta[row]):.0f}° off the axis enter {abs(shift):.2g}{band} mm {side}."
