"""CameraInfo as the YAML that camera_info_manager reads."""

from __future__ import annotations

from fisheye_ep_calib.storage.camera_info import PlainCameraInfo


def camera_info_content(info: PlainCameraInfo, name: str) -> dict:
    """The keys in camera_info_manager's order."""
    return {
        "image_width": int(info.width),
        "image_height": int(info.height),
        "camera_name": str(name),
        "camera_matrix": _matrix(3, 3, info.k),
        "distortion_model": info.distortion_model,
        "distortion_coefficients": _matrix(1, len(info.d), info.d),
        "rectification_matrix": _matrix(3, 3, info.r),
        "projection_matrix": _matrix(3, 4, info.p),
    }


def _matrix(rows: int, columns: int, values) -> dict:
    return {"rows": rows, "cols": columns, "data": [float(value) for value in values]}
