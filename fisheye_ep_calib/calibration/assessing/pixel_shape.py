"""Whether the pixels are square, as those of nearly every sensor are."""

from __future__ import annotations

from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.camera import FisheyeCamera

_UNEQUAL = 0.02  # |fx / fy − 1|, beyond which something other than the sensor is likelier


def pixels_not_square(camera: FisheyeCamera) -> Finding:
    """fx and fy are the focal length in a pixel's width and in its height."""
    excess = camera.fx / camera.fy - 1
    values = {"fx_px": camera.fx, "fy_px": camera.fy, "excess": excess}
    if abs(excess) <= _UNEQUAL:
        return Finding("pixels_not_square", values, False, f"fx and fy agree within {100 * abs(excess):.2f} %")
    larger, smaller = ("fx", "fy") if excess > 0 else ("fy", "fx")
    told = (
        f"{larger} is {100 * (max(camera.fx, camera.fy) / min(camera.fx, camera.fy) - 1):.1f} % larger than {smaller}: "
        "sensors have square pixels, so check whether the image was scaled or cropped unevenly by the driver, and "
        "whether the target's spacings in x and y are as its file says"
    )
    return Finding("pixels_not_square", values, True, told)
