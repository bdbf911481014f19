"""Fisheye calibration with a moving entrance pupil."""

import importlib

TYPE_CHECKING = False  # typing's own would have to be imported
if TYPE_CHECKING:
    from fisheye_ep_calib.calibration import CalibrationResult, Observations, calibrate
    from fisheye_ep_calib.camera import FisheyeCamera
    from fisheye_ep_calib.errors import CalibrationError, InputError
    from fisheye_ep_calib.storage.camera_file import load_camera, save_camera
    from fisheye_ep_calib.version import __version__

__all__ = [
    "CalibrationError",
    "CalibrationResult",
    "FisheyeCamera",
    "InputError",
    "Observations",
    "__version__",
    "calibrate",
    "load_camera",
    "save_camera",
]
_MODULES = {
    "calibration": ("CalibrationResult", "Observations", "calibrate"),
    "camera": ("FisheyeCamera",),
    "errors": ("CalibrationError", "InputError"),
    "storage.camera_file": ("load_camera", "save_camera"),
    "version": ("__version__",),
}


def __getattr__(name: str) -> object:
    """Imports a name when it is asked for: the command line is to answer Ctrl-C before NumPy is there."""
    for module, names in _MODULES.items():
        if name in names or name == module.partition(".")[0]:
            found = importlib.import_module(f"{__name__}.{module}")  # makes its room an attribute too
            return getattr(found, name) if name in names else globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
