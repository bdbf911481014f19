"""A rig as a piece of URDF: a link a camera, a fixed joint from the reference to each other one.

origin is the child in the parent's frame; rpy turn about the fixed axes x, y and z, in this order. The links are
optical frames: x right, y down, z forward. (URDF, joint/origin.)
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.placed_camera import PlacedCamera, floats
from fisheye_ep_calib.formats.static_transform import frame_of, several


def write(cameras: Sequence[PlacedCamera], _named: Named) -> Written:
    """A robot of its own, to be copied from."""
    from xml.sax.saxutils import quoteattr  # loads the network's modules too, which every command would wait for

    from scipy.spatial.transform import Rotation

    parent = frame_of(several(cameras)[0].name)
    words = (f"links NAME_optical_frame: x right, y down, z forward; the parent is {parent}",)
    comments = (re.sub("-(?=-)", "- ", line) for line in words)  # XML ends a comment at two hyphens
    lines = ['<?xml version="1.0"?>', *(f"<!-- {line} -->" for line in comments), '<robot name="cameras">']
    lines += [f"  <link name={quoteattr(frame_of(placed.name))}/>" for placed in cameras]
    for placed in cameras[1:]:
        turn = Rotation.from_matrix(placed.reference_from_camera[:3, :3]).as_euler("xyz")
        shift = floats(placed.reference_from_camera[:3, 3])
        xyz, rpy = (" ".join(map(repr, values)) for values in (shift, floats(turn)))
        lines += [
            f'  <joint name={quoteattr(f"{placed.name}_optical_joint")} type="fixed">',
            f"    <parent link={quoteattr(parent)}/>",
            f"    <child link={quoteattr(frame_of(placed.name))}/>",
            f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
            "  </joint>",
        ]
    return Written({"": "\n".join([*lines, "</robot>", ""])}, words)


URDF = Format("urdf", "links and fixed joints of a rig", write, places_only=True)
