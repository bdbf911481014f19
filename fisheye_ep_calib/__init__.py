"""Fisheye calibration with a moving entrance pupil: the public face, for programs and notebooks.

cameras = calibrate_recording("recording.mcap", "circle_grid_11x7", topics={"front": "/front/image_raw"})
front = cameras["front"]
front.verdict, front.findings
front.write("calibration")
front.report("report.html")
front.plot.entrance_pupil()
"""

import importlib

from fisheye_ep_calib.moved_modules import find_moved_modules

TYPE_CHECKING = False  # typing's own would have to be imported
if TYPE_CHECKING:
    from fisheye_ep_calib.calibration import CalibrationResult, Observations
    from fisheye_ep_calib.camera import FisheyeCamera
    from fisheye_ep_calib.errors import CalibrationError, InputError, Interrupted
    from fisheye_ep_calib.pipeline import (
        CalibratedCamera,
        CalibratedCameras,
        ComparedCameras,
        EvaluatedCamera,
        calibrate_recording,
        compare,
        evaluate,
        export,
        find_target,
    )
    from fisheye_ep_calib.pipeline import calibrate_observations as calibrate
    from fisheye_ep_calib.rectification import rectify
    from fisheye_ep_calib.storage.camera_file import load_camera, save_camera
    from fisheye_ep_calib.storage.recording import open_recording
    from fisheye_ep_calib.target import load_target
    from fisheye_ep_calib.version import __version__

__all__ = [
    "CalibratedCamera",
    "CalibratedCameras",
    "CalibrationError",
    "CalibrationResult",
    "ComparedCameras",
    "EvaluatedCamera",
    "FisheyeCamera",
    "InputError",
    "Interrupted",
    "Observations",
    "__version__",
    "calibrate",
    "calibrate_recording",
    "compare",
    "evaluate",
    "export",
    "find_target",
    "load_camera",
    "load_target",
    "open_recording",
    "rectify",
    "save_camera",
]
_MODULES = {
    "calibration": ("CalibrationResult", "Observations"),
    "camera": ("FisheyeCamera",),
    "errors": ("CalibrationError", "InputError", "Interrupted"),
    "pipeline": (
        "CalibratedCamera",
        "CalibratedCameras",
        "ComparedCameras",
        "EvaluatedCamera",
        "calibrate_observations",
        "calibrate_recording",
        "compare",
        "evaluate",
        "export",
        "find_target",
    ),
    "rectification": ("rectify",),
    "storage.camera_file": ("load_camera", "save_camera"),
    "storage.recording": ("open_recording",),
    "target": ("load_target",),
    "version": ("__version__",),
}
_ROOMS_NAMES = {"calibrate": "calibrate_observations"}  # what a room calls it, where that differs

find_moved_modules()


def __getattr__(name: str) -> object:
    """Imports a name when it is asked for: the command line is to answer Ctrl-C before NumPy is there."""
    own = _ROOMS_NAMES.get(name, name)
    for module, names in _MODULES.items():
        if name in __all__ and own in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), own)
        if name == module.partition(".")[0]:
            importlib.import_module(f"{__name__}.{module}")  # makes its room an attribute too
            return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
