"""What a calibration estimates: the family of the pupil, the lens and what is added to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.field_prior import FieldPrior
from fisheye_ep_calib.calibration.pupil_prior import PupilPrior
from fisheye_ep_calib.camera import KNOWN_EXTRAS, KNOWN_LENSES, LENS_EXTRAS, LENSES, PUPIL_FAMILIES, FisheyeCamera
from fisheye_ep_calib.camera.extras.tangential import TANGENTIAL
from fisheye_ep_calib.camera.parameters import pupil_names
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import shown
from fisheye_ep_calib.target.shape.bow import WARP_NAMES
from fisheye_ep_calib.target.shape.model import BOW, FLAT

LENS = "kannala_brandt"  # unless another is asked for, or needed
FREER_LENS = "kannala_brandt_6"
_ANGLES = 60  # at which curves are compared


@dataclass(frozen=True)
class Structure:
    """model: key of PUPIL_FAMILIES. terms: of E(θ); None takes the family's own number.

    lens: key of LENSES. skew: whether it is estimated or zero. extras: names of LENS_EXTRAS that are estimated.
    board_shape: what the target may be: "flat", "bow" (three terms) or "free" (target/shape/). target_axis: the
    paper's equation as printed; no camera. held: the camera stays as it is; poses and the target's shape alone are
    estimated. pupil_prior, field_prior: what is known beforehand of the pupil's last terms, and of a lens field; None
    where nothing is.
    """

    model: str = "ep_even"
    terms: int | None = None
    lens: str = LENS
    skew: bool = True
    extras: tuple[str, ...] = ()
    board_shape: str = FLAT
    target_axis: bool = False
    held: bool = False
    pupil_prior: PupilPrior | None = None
    field_prior: FieldPrior | None = None

    @staticmethod
    def of_camera(camera: FisheyeCamera, board_shape: str = FLAT) -> Structure:
        """A camera that is known, held."""
        terms, extras = len(camera.coefficients) or None, tuple(camera.extras)
        return Structure(camera.model, terms, camera.lens, True, extras, board_shape, held=True)

    @property
    def estimated(self) -> Structure:
        """The same with the camera estimated.

        Kannala and Brandt's lens with tangential terms takes the place of other calibrators', which are held alone.
        """
        extras = tuple(name for name in self.extras if name in LENS_EXTRAS)
        if extras != self.extras:
            extras = tuple(dict.fromkeys((*extras, TANGENTIAL.name)))
        return replace(self, held=False, lens=self.lens if self.lens in LENSES else LENS, extras=extras)

    def __post_init__(self) -> None:
        if self.model not in PUPIL_FAMILIES:
            raise InputError(f"unknown model {shown(self.model)}; known: {', '.join(PUPIL_FAMILIES)}, auto")
        lenses, extras = (KNOWN_LENSES, KNOWN_EXTRAS) if self.held else (LENSES, LENS_EXTRAS)
        if self.lens not in lenses:
            raise InputError(f"unknown lens {shown(self.lens)}; known: {', '.join(lenses)}")
        for name in self.extras:
            if name not in extras:
                raise InputError(f"unknown lens extra {shown(name)}; known: {', '.join(extras)}")
        most = PUPIL_FAMILIES[self.model].max_terms
        if self.terms is not None and self.model != CENTRAL_MODEL and self.terms not in range(1, most + 1):
            raise InputError(f"{self.model} takes 1 to {most} terms, not {self.terms}")

    @property
    def name(self) -> str:
        """What the user calls the model."""
        return f"{self.model}_target_axis" if self.target_axis else self.model

    @property
    def pupil_terms(self) -> int:
        family = PUPIL_FAMILIES[self.model]
        if family.max_terms == 0 or self.terms is None:
            return family.default_terms
        return self.terms

    @property
    def parameter_count(self) -> int:
        """Shared parameters that are estimated."""
        if self.held:
            return len(WARP_NAMES) * (self.board_shape == BOW)
        extras = sum(len(KNOWN_EXTRAS[name].coefficient_names) for name in self.extras)
        lens = len(KNOWN_LENSES[self.lens].coefficient_names)
        return 4 + self.skew + lens + extras + self.pupil_terms + len(WARP_NAMES) * (self.board_shape == BOW)

    def camera(self, image_size: tuple[int, int], focal_lengths: np.ndarray, centre: np.ndarray) -> FisheyeCamera:
        """The camera to start from: no pupil shift, no skew, no extras at work. focal_lengths, centre (2,): px."""
        return FisheyeCamera(
            image_size,
            float(focal_lengths[0]),
            float(focal_lengths[1]),
            float(centre[0]),
            float(centre[1]),
            radial=KNOWN_LENSES[self.lens].start_coefficients,
            model=self.model,
            coefficients=(0.0,) * self.pupil_terms,
            extras={name: (0.0,) * len(KNOWN_EXTRAS[name].coefficient_names) for name in self.extras},
            lens=self.lens,
        )

    def camera_like(self, other: FisheyeCamera, largest_angle: float = np.pi / 2) -> FisheyeCamera:
        """This structure's camera with every parameter that it shares with another's; the rest starts at zero.

        A pupil of other terms, and a lens of fewer or in place of one that is only held, start where their curves come
        nearest to the other's up to the largest angle, rad: a series cut short is another curve.
        """
        start = self.camera(other.image_size, np.array([other.fx, other.fy]), np.array([other.cx, other.cy]))
        shared = dict(zip(other.parameter_names, other.parameters, strict=True))
        theta = np.linspace(0.0, largest_angle, _ANGLES + 1)[1:]
        if other.model != self.model or len(other.coefficients) > self.pupil_terms:
            for name in pupil_names(len(other.coefficients)):
                del shared[name]
            shared |= zip(pupil_names(self.pupil_terms), self._pupil_like(other, theta), strict=True)
        if _is_series_cut_short(self.lens, other.lens) or (self.lens == LENS and other.lens not in LENSES):
            names = KNOWN_LENSES[self.lens].coefficient_names
            columns = start.lens_model.radius_jacobian(theta, start.radial_array).T
            radial = np.linalg.lstsq(columns, other.radius(theta) - theta, rcond=None)[0]
            shared |= zip(names, radial.tolist(), strict=True)
        if not self.skew:
            shared["skew"] = 0.0
        values = [shared.get(name, value) for name, value in zip(start.parameter_names, start.parameters, strict=True)]
        return start.with_parameters(np.array(values))

    def _pupil_like(self, other: FisheyeCamera, theta: np.ndarray) -> list[float]:
        """Coefficients of this structure's E(θ) that come nearest to another's at angles (n,), rad."""
        if not self.pupil_terms or not any(other.coefficients):
            return [0.0] * self.pupil_terms
        basis = PUPIL_FAMILIES[self.model].basis(theta, self.pupil_terms)
        coefficients: list[float] = np.linalg.lstsq(basis.T, other.entrance_pupil(theta), rcond=None)[0].tolist()
        return coefficients

    def free(self, camera: FisheyeCamera) -> np.ndarray:
        """bool (P,): which of camera.parameters are estimated."""
        return np.array([not self.held and (name != "skew" or self.skew) for name in camera.parameter_names])


def _is_series_cut_short(lens: str, other: str) -> bool:
    """Whether a lens is Kannala and Brandt's polynomial with fewer terms than another's."""
    both = {lens, other} <= {LENS, FREER_LENS}
    return both and len(KNOWN_LENSES[lens].coefficient_names) < len(KNOWN_LENSES[other].coefficient_names)
