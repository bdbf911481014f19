"""Published prescriptions of fisheye lenses, one entry a lens: truths that no camera model was made for.

The numbers of a patent's or a textbook's table are facts; each entry names its own. Those of patents were read from the
tables that ronbuening/LensVisualizer and zpelgrims/lentil (GitHub) have of them, and checked: a test traces every lens,
and holds its focal length and where it is sharp against what is published.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from fisheye_ep_calib.simulation.prescription import Prescription


@dataclass(frozen=True)
class PublishedLens:
    """source: whose, and where. focal_length: as published, in the table's unit; None where it is not.

    half_field: degrees, for which it was designed. stop: number of its surface. surfaces: radius of curvature, distance
    to the next, the last one to the sensor (None: to where it is sharp), index of refraction behind; from the scene on.
    """

    source: str
    focal_length: float | None
    half_field: float
    stop: int
    surfaces: tuple[tuple[float, float | None, float], ...]

    @property
    def prescription(self) -> Prescription:
        """In the table's unit."""
        radii, thicknesses, indices = zip(*self.surfaces, strict=True)
        if thicknesses[-1] is not None:
            return Prescription(radii, thicknesses, indices, self.stop)
        lens = Prescription(radii, (*thicknesses[:-1], 0.0), indices, self.stop)
        return Prescription(radii, (*thicknesses[:-1], lens.back_focus), indices, self.stop)


def published_lens(name: str, focal_length: float) -> Prescription:
    """A lens of PUBLISHED_LENSES, scaled to a focal length, metres."""
    lens = PUBLISHED_LENSES[name].prescription
    return lens.scaled(focal_length / lens.focal_length)


PUBLISHED_LENSES: Mapping[str, PublishedLens] = {
    "laikin_170": PublishedLens(
        "M. Laikin, Lens Design, 4th ed., CRC Press 2007, p. 114, a 170° f/1.8 lens (optiland 0.6.3, MIT, "
        "optiland.samples.objectives.WideAngle170FOV); Schott catalogue indices",
        None,
        85,
        12,
        (
            (6.0515, 0.1796, 1.5168),
            (1.2087, 0.9182, 1.0),
            (-9.4697, 0.1939, 1.58913),
            (1.0053, 0.6402, 1.0),
            (1.6634, 0.4518, 1.71736),
            (-1.6712, 0.1825, 1.691),
            (1.1206, 2.5272, 1.0),
            (1.3895, 0.2500, 1.691),
            (0.5522, 0.6047, 1.55232),
            (-0.8844, 0.0196, 1.0),
            (-0.8804, 0.0800, 1.71736),
            (-2.1545, 0.1200, 1.0),
            (inf, 0.1200, 1.0),
            (1.0354, 0.4830, 1.55232),
            (-0.8443, 0.0546, 1.0),
            (-0.7386, 0.1076, 1.71736),
            (-1.5285, 0.8308, 1.0),
        ),
    ),
    "laikin_160": PublishedLens(
        "M. Laikin, Lens Design, 4th ed., CRC Press 2007, p. 112 (as in optiland 0.6.3, MIT); Schott catalogue indices",
        None,
        80,
        10,
        (
            (38.915, 0.5459, 1.5168),
            (3.6152, 1.6595, 1.0),
            (inf, 0.6927, 1.5168),
            (5.2515, 1.4576, 1.0),
            (-5.2515, 0.6927, 1.5168),
            (inf, 4.1494, 1.0),
            (5.1075, 0.7, 1.7552),
            (-10.8385, 0.0162, 1.0),
            (2.3897, 0.7443, 1.7552),
            (2.2789, 0.1136, 1.0),
            (inf, 0.104, 1.0),
            (-2.3536, 0.7038, 1.71736),
            (2.7829, 0.5423, 1.6516),
            (-2.8287, 0.2506, 1.0),
            (13.1578, 0.635, 1.6516),
            (-1.4944, 0.2922, 1.7552),
            (-4.8082, 0.0668, 1.0),
            (4.3447, 0.5059, 1.6405),
            (72.8673, 2.2376, 1.0),
        ),
    ),
    "matsushita_15": PublishedLens(
        "JP S63-17421 A, numerical example 3 (T. Matsushita, 1988): 15 mm f/2.8",
        15.3,
        90,
        8,
        (
            (78.06, 2.5, 1.60311),
            (15.9, 11.83, 1.0),
            (22.22, 2.5, 1.617),
            (13.27, 7.54, 1.0),
            (127.88, 5.34, 1.60311),
            (22.35, 1.85, 1.0),
            (32.04, 6.71, 1.84666),
            (-190.22, 3.84, 1.0),
            (inf, 3.53, 1.0),
            (-289.77, 2.72, 1.51112),
            (-29.1, 0.15, 1.0),
            (-100.42, 3.99, 1.84666),
            (29.39, 5.14, 1.48749),
            (-25.73, 0.15, 1.0),
            (43.88, 4.84, 1.48749),
            (-43.88, None, 1.0),
        ),
    ),
    "ogura_16": PublishedLens(
        "US 3,589,798, example II (T. Ogura, 1971): 16 mm f/2.8, its plane filter as air of the same t/n",
        16.0,
        90,
        9,
        (
            (121.331, 2.08, 1.6204),
            (18.992, 7.8544, 1.0),
            (39.6592, 1.92, 1.6176),
            (16.7424, 7.6544, 1.0),
            (-43.368, 1.6, 1.6205),
            (67.2912, 7.5216, 1.7495),
            (-51.664, 0.144, 1.0),
            (34.7952, 7.592, 1.733),
            (inf, 2.53335, 1.0),
            (inf, 4.7696, 1.0),
            (-27.32, 5.4096, 1.6214),
            (-9.7264, 2.3696, 1.733),
            (-21.4528, 0.144, 1.0),
            (-129.2096, 1.36, 1.74),
            (25.8256, 6.32, 1.5688),
            (-32.72, 0.144, 1.0),
            (53.8352, 4.56, 1.5168),
            (-56.5568, None, 1.0),
        ),
    ),
    "sato_16": PublishedLens(
        "US 5,434,713, example 1 (H. Sato, 1995): 16 mm f/2.8, its plane filter as air of the same t/n",
        15.7,
        90,
        7,
        (
            (69.258, 1.7, 1.64),
            (15.165, 10.25, 1.0),
            (130.505, 1.7, 1.62041),
            (14.794, 4.0, 1.0),
            (32.412, 8.0, 1.62588),
            (-15.298, 9.0, 1.79668),
            (-38.75, 6.47, 1.0),
            (inf, 4.5183, 1.0),
            (-81.004, 1.2, 1.58144),
            (24.002, 5.0, 1.51823),
            (-20.609, 0.1, 1.0),
            (46.733, 5.5, 1.5186),
            (-19.219, 1.3, 1.7847),
            (-40.706, None, 1.0),
        ),
    ),
    "mizuguchi_10": PublishedLens(
        "US 7,161,746 B2, example 9 (K. Mizuguchi, 2007): 10.5 mm f/2.8; the stop 6.4398 before the "
        "next surface, as its total length and focal length have it",
        10.6,
        90,
        12,
        (
            (85.0, 2.04, 1.62041),
            (16.45, 8.32, 1.0),
            (61.18, 1.7, 1.816),
            (20.15, 10.316, 1.0),
            (-204.0, 3.43, 1.72),
            (-31.26, 0.25, 1.0),
            (-27.0, 2.78, 1.7725),
            (11.48, 4.93, 1.72825),
            (-55.84, 5.865, 1.0),
            (59.67, 2.57, 1.51742),
            (-14.2, 1.41, 1.83481),
            (-76.0, 3.66, 1.0),
            (inf, 6.4398, 1.0),
            (-1732.0, 1.49, 1.84666),
            (29.9, 4.02, 1.497),
            (-21.55, 0.19, 1.0),
            (44.74, 3.21, 1.6516),
            (-44.74, None, 1.0),
        ),
    ),
    "isshiki_6": PublishedLens(
        "US 3,524,697, example 1 (M. Isshiki and K. Matsuki, 1970): 6 mm f/5.6; its plane filter as "
        "air of the same t/n",
        6.0,
        110,
        7,
        (
            (53.2086, 2.69875, 1.61272),
            (18.2052, 14.69322, 1.0),
            (53.7514, 2.33892, 1.62041),
            (8.57664, 9.29571, 1.0),
            (-39.7508, 0.77964, 1.48848),
            (10.2715, 3.47839, 1.7847),
            (35.7351, 3.26976, 1.0),
            (inf, 3.23851, 1.0),
            (-1931.61786, 3.35845, 1.78477),
            (8.8855, 6.77687, 1.74372),
            (-33.8034, 0.11994, 1.0),
            (-183.504, 2.87867, 1.76764),
            (-17.3848, 10.31524, 1.0),
            (38.6324, 1.55928, 1.78485),
            (13.3283, 10.43518, 1.6223),
            (-41.6856, 10.71129, 1.0),
        ),
    ),
    "nakagawa_8": PublishedLens(
        "DE 2157160 A1, example 1 (J. Nakagawa, 1973): 8 mm f/2.8",
        8.0,
        90,
        11,
        (
            (95.0304, 2.7232, 1.5891),
            (20.0848, 19.064, 1.0),
            (67.308, 4.1336, 1.7847),
            (147.913, 1.9456, 1.5891),
            (17.24, 14.0448, 1.0),
            (-303.422, 1.556, 1.67),
            (17.24, 4.7656, 1.6668),
            (97.7904, 8.0456, 1.0),
            (151.793, 1.9456, 1.7865),
            (10.8672, 6.7016, 1.6032),
            (-44.8096, 8.5176, 1.0),
            (inf, 3.6504, 1.0),
            (-61.8168, 4.5424, 1.5173),
            (-25.4472, 0.1944, 1.0),
            (26.6992, 1.4592, 1.9229),
            (16.4376, 4.9896, 1.5173),
            (-29.1208, 36.684, 1.0),
        ),
    ),
    "adachi_8": PublishedLens(
        "US 2012/0147254 A1, example 4 (N. Adachi and T. Imaoka, 2012): 8 mm f/3.5",
        7.85,
        90,
        10,
        (
            (48.254, 1.7, 1.6968),
            (14.299, 7.18, 1.0),
            (142.5, 1.5, 1.6968),
            (11.257, 6.27, 1.0),
            (-47.621, 2.9, 1.80518),
            (-19.391, 0.56, 1.0),
            (-17.239, 0.8, 1.497),
            (750.0, 3.06, 1.0),
            (14.505, 2.2, 1.8061),
            (52.423, 4.608, 1.0),
            (inf, 2.402, 1.0),
            (-86.523, 1.6, 1.7725),
            (-16.697, 0.23, 1.0),
            (-16.036, 3.0, 1.58913),
            (-6.087, 1.82, 1.84666),
            (-14.719, 4.513, 1.0),
            (500.0, 2.8, 1.618),
            (-24.06, 2.105, 1.0),
            (106.24, 2.4, 1.5168),
            (-106.24, 16.169, 1.0),
        ),
    ),
    "muller_16": PublishedLens(
        "R. Muller, US 4,525,038 (1985), as in W. J. Smith, Modern Lens Design, 1992, p. 164: f/4, 156 degrees",
        10.0,
        78,
        6,
        (
            (30.2249, 0.8335, 1.62),
            (11.3931, 7.4136, 1.0),
            (75.2019, 1.0654, 1.639),
            (8.3349, 11.1549, 1.0),
            (9.5882, 2.0054, 1.654),
            (43.8677, 5.3895, 1.0),
            (inf, 1.4163, 1.0),
            (29.4541, 2.1934, 1.517),
            (-5.2265, 0.9714, 1.805),
            (-14.2884, 0.0627, 1.0),
            (-22.3726, 0.94, 1.673),
            (-15.0404, None, 1.0),
        ),
    ),
    "horimoto_16": PublishedLens(
        "US 4,256,373 (M. Horimoto, 1981): f/2.8",
        1.0,
        90,
        11,
        (
            (4.7033, 0.1305, 1.713),
            (0.8146, 0.5754, 1.0),
            (2.3433, 0.0979, 1.62041),
            (0.7204, 0.3269, 1.0),
            (1.4258, 0.251, 1.71736),
            (-8.7833, 0.0063, 1.0),
            (2.8016, 0.1632, 1.59551),
            (-3.3885, 0.0653, 1.744),
            (2.8217, 0.1305, 1.0),
            (inf, 0.0916, 1.5186),
            (inf, 0.0979, 1.0),
            (inf, 0.0979, 1.0),
            (-4.4012, 0.3269, 1.497),
            (-0.9403, 0.0063, 1.0),
            (3.7044, 0.2943, 1.48749),
            (-0.7556, 0.0916, 1.84666),
            (-1.4548, None, 1.0),
        ),
    ),
}
