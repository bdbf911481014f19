"""A pytest plugin that registers parts from outside: right ones, and ones with a fault that the contracts must find.

``pytest -p foreign_entries``, with this folder on PYTHONPATH. Names begin with right_ and wrong_.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, replace
from functools import partial
from io import BytesIO
from pathlib import Path

import bag_writers
import foreign_readers
import numpy as np

from fisheye_ep_calib.camera import LENS_EXTRAS, LENSES, PUPIL_FAMILIES
from fisheye_ep_calib.camera.extras.extra import PlaneJacobian, invert_by_newton
from fisheye_ep_calib.camera.extras.tangential import Tangential
from fisheye_ep_calib.camera.lenses.kannala_brandt import KannalaBrandt
from fisheye_ep_calib.camera.pupils.family import PowerPupil
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.formats import FORMATS, Format
from fisheye_ep_calib.formats.kalibr import KALIBR
from fisheye_ep_calib.rectification.projections import PROJECTIONS, Cylindrical
from fisheye_ep_calib.storage.sources.base import BagSource, Entry
from fisheye_ep_calib.storage.sources.find import BAG_FORMATS, BagFormat
from fisheye_ep_calib.target.base import Artwork, Target, rectangular_grid
from fisheye_ep_calib.target.boards.chessboard import Chessboard
from fisheye_ep_calib.target.corners.chessboard_detector import ChessboardDetector
from fisheye_ep_calib.target.registry import TARGETS
from fisheye_ep_calib.target.schema import Keys

# ---- pupils ----------------------------------------------------------------------------------------------------------


class CosinePupil:
    """E(θ) = Σ e_i (1 − cosθ)^i."""

    default_terms = 2
    max_terms = 3

    def basis(self, theta, terms):
        powers = np.arange(1, terms + 1).reshape(-1, *(1,) * np.ndim(theta))
        return (1 - np.cos(theta)) ** powers

    def basis_derivative(self, theta, terms):
        powers = np.arange(1, terms + 1).reshape(-1, *(1,) * np.ndim(theta))
        return powers * (1 - np.cos(theta)) ** (powers - 1) * np.sin(theta)


class WrongSign(PowerPupil):
    def basis_derivative(self, theta, terms):
        return -super().basis_derivative(theta, terms)


class OffTheAxis(PowerPupil):
    def basis(self, theta, terms):
        return super().basis(theta, terms) + 1.0


# ---- lenses ----------------------------------------------------------------------------------------------------------


class HalfTangent:
    """r = 2 tan(θ/2) + s1 θ³ + s2 θ⁵: a stereographic lens with a polynomial."""

    name = "right_half_tangent"
    coefficient_names = ("s1", "s2")
    start_coefficients = (0.0, 0.0)

    def radius(self, theta, coefficients):
        first, second = coefficients
        return 2 * np.tan(theta / 2) + first * theta**3 + second * theta**5

    def radius_derivative(self, theta, coefficients):
        first, second = coefficients
        return 1 / np.cos(theta / 2) ** 2 + 3 * first * theta**2 + 5 * second * theta**4

    def radius_jacobian(self, theta, coefficients):
        return np.stack([theta**3, theta**5])


class WrongColumn(KannalaBrandt):
    def radius_jacobian(self, theta, coefficients):
        jacobian = super().radius_jacobian(theta, coefficients)
        jacobian[2] *= 1.01
        return jacobian


# ---- extras ----------------------------------------------------------------------------------------------------------


class ThinPrism:
    """x′ = x + n1 r², y′ = y + n2 r² (Weng, Cohen and Herniou, 1992)."""

    name = "right_prism"
    summary = "a thin prism: n1, n2"
    coefficient_names = ("n1", "n2")

    def apply(self, x, y, coefficients):
        square = x * x + y * y
        return x + coefficients[0] * square, y + coefficients[1] * square

    def jacobian(self, x, y, coefficients):
        first, second = coefficients
        plane = PlaneJacobian(1 + 2 * first * x, 2 * first * y, 2 * second * x, 1 + 2 * second * y)
        square, none = x * x + y * y, np.zeros(np.shape(x))
        return plane, np.stack([np.stack([square, none]), np.stack([none, square])])

    def invert(self, x, y, coefficients):
        return invert_by_newton(self, x, y, coefficients)


class RoughInverse(Tangential):
    name = "wrong_inverse"
    coefficient_names = ("m1", "m2")

    def invert(self, x, y, coefficients):
        x, y = self.apply(x, y, -np.asarray(coefficients))
        return x, y, np.ones(np.shape(x), dtype=bool)


# ---- projections -----------------------------------------------------------------------------------------------------


class Stereographic:
    """(x, y) = 2 tan(θ/2) (cosφ, sinφ): shapes stay what they are."""

    largest_fov = np.radians(300)
    usual_fov = np.radians(180)
    surface = "sphere"
    pinhole = False

    def half_extent(self, angle):
        return float(2 * np.tan(angle / 2))

    def half_height(self, half_width, aspect):
        return half_width * aspect

    def points(self, x, y):
        x, y = np.broadcast_arrays(x, y)
        square = x * x + y * y
        return np.stack([4 * x, 4 * y, 4 - square], axis=-1) / (4 + square)[..., None]

    def plane(self, points):
        scale = points[..., 2] + np.linalg.norm(points, axis=-1)
        scale = np.where(scale > 1e-9, scale, np.nan) / 2
        return points[..., 0] / scale, points[..., 1] / scale


class Mirrored(Cylindrical):
    def points(self, x, y):
        return super().points(-x, y)


# ---- targets ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class OwnTarget(Target):
    """A board of its own: squares that are not square, in keys of its own, measured by a detector that is there."""

    board: Chessboard

    kind = "right_target"

    @staticmethod
    def from_keys(keys: Keys, name: str) -> OwnTarget:
        keys.only(("type", "name", "corners_across", "corners_down", "width"))
        across, down = keys.count("corners_across", 3), keys.count("corners_down", 3)
        width = keys.metres("width")
        board = Chessboard.create(name, across, down, width, 0.8 * width)
        return OwnTarget(keys.text("name", name), rectangular_grid(across, down, width, 0.8 * width), None, board)

    def detector(self) -> ChessboardDetector:
        return ChessboardDetector(self.board)

    def artwork(self) -> Artwork:
        return self.board.artwork()


class Permuted(OwnTarget):
    """Two of its points have each other's names."""

    kind = "wrong_permuted"

    @staticmethod
    def from_keys(keys: Keys, name: str) -> Permuted:
        right = OwnTarget.from_keys(keys, name)
        points = right.object_points.copy()
        points[[10, 11]] = points[[11, 10]]
        return Permuted(right.name, points, None, right.board)


class FalseClaim(Chessboard):
    """A plain board that looks alike when it is turned by half, and says that it does not."""

    kind = "wrong_claim"
    kalibr_kind = ""
    unmistakable = True

    @staticmethod
    def from_keys(keys: Keys, name: str) -> FalseClaim:
        board = Chessboard.from_keys(keys, name)
        even = Chessboard.create(board.name, 8, 6, board.spacing)
        return FalseClaim(even.name, even.object_points, None, 8, 6, even.spacing, even.row_spacing)


# ---- bags ------------------------------------------------------------------------------------------------------------


_RIGHT, _WRONG = b"RIGHTBOX", b"WRONGBOX"


class BoxedBag(BagSource):
    """Serialized messages in an .npz behind eight bytes of its own. Location: (first byte, number of bytes)."""

    def list_images(self) -> None:
        try:
            box = np.load(BytesIO(self.path.read_bytes()[8:]), allow_pickle=False)
            topics, types = box["topics"].tolist(), box["types"].tolist()
            rows = box["rows"].tolist()
            self._data = box["data"].tobytes()
        except (ValueError, KeyError, EOFError, zipfile.BadZipFile, NotImplementedError) as error:
            raise InputError(f"{self.path} is no box of messages: {type(error).__name__}") from None
        readable = [self._add_topic(topic, kind, "cdr") for topic, kind in zip(topics, types, strict=True)]
        for number, stamp, first, count in rows:
            if readable[number]:
                self.entries[topics[number]].append(Entry(stamp, (first, count)))

    def read(self, topic: str, entry: Entry) -> bytes:
        first, count = entry.location
        return self._data[first : first + count]


class ForgetfulBag(BoxedBag):
    """Every image is the first one."""

    def read(self, topic: str, entry: Entry) -> bytes:
        return super().read(topic, self.entries[topic][0])


def write_box(path: Path, recorded, begin: bytes = _RIGHT) -> Path:
    topics: dict[str, str] = {}
    rows, data = [], b""
    for topic, stamp, kind, image in recorded:
        images = (bag_writers.IMAGE, bag_writers.COMPRESSED_IMAGE)
        topics.setdefault(topic, kind if kind in images else "std_msgs/msg/String")
        content = bag_writers.serialize(kind, image, stamp)
        rows.append((list(topics).index(topic), stamp, len(data), len(content)))
        data += content
    with open(path, "wb") as file:
        file.write(begin)
        boxed = {"topics": list(topics), "types": list(topics.values()), "rows": np.array(rows)}
        box = BytesIO()
        np.savez(box, **boxed, data=np.frombuffer(data, np.uint8))
        file.write(box.getvalue())
    return path


# ---- formats ---------------------------------------------------------------------------------------------------------


def write_half_a_pixel_off(cameras, named):
    """As if (0, 0) were the corner of the top-left pixel."""
    moved = [replace(one, camera=replace(one.camera, cx=one.camera.cx + 0.5)) for one in cameras]
    return KALIBR.write(moved, named)


FORMATS |= {
    "right_camchain": Format("right_camchain", "Kalibr's by another name", KALIBR.write),
    "wrong_corner": Format("wrong_corner", "Kalibr's, half a pixel off", write_half_a_pixel_off),
}
foreign_readers.READERS |= dict.fromkeys(("right_camchain", "wrong_corner"), foreign_readers.read_kalibr)
PUPIL_FAMILIES |= {
    "right_cosine": CosinePupil(),
    "wrong_sign": WrongSign(2, 2, 4),
    "wrong_off_axis": OffTheAxis(2, 2, 4),
}
LENSES |= {"right_half_tangent": HalfTangent(), "wrong_column": WrongColumn("wrong_column", 4)}
LENS_EXTRAS |= {extra.name: extra for extra in (ThinPrism(), RoughInverse())}
PROJECTIONS |= {"right_stereographic": Stereographic(), "wrong_mirrored": Mirrored()}
TARGETS |= {kind.kind: kind for kind in (OwnTarget, Permuted, FalseClaim)}
BAG_FORMATS |= {
    ".right_box": BagFormat(".right_box", _RIGHT, "foreign_entries", "BoxedBag"),
    ".wrong_box": BagFormat(".wrong_box", _WRONG, "foreign_entries", "ForgetfulBag"),
}
bag_writers.WRITERS |= {".right_box": write_box, ".wrong_box": partial(write_box, begin=_WRONG)}
