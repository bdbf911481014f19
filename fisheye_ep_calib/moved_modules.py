"""Modules that have moved to another room: their former names work for one version, with a warning."""

import sys
import warnings
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType

_PACKAGE = "fisheye_ep_calib."
# Room → former names in it, each with its new place where that is not the same name in the new room.
_MOVED = {
    "calibration.estimating": {
        "calibration": "adjustment fit initialization levenberg_marquardt normal_equations pose_repair prediction "
        "ray_pose robust target_axis views"
    },
    "calibration.selecting": {"calibration": "cross_validation model_selection nested_tests outliers"},
    "calibration.assessing": {
        "calibration": "camera_difference coverage diagnosis evaluation family_spread stand_in uncertainty"
    },
    "planning": {
        "calibration": "guidance view_information view_selection",
        "collection": "choice=image_choice information=image_information",
    },
    "target.boards": {"target": "circle_grid chessboard charuco aprilgrid"},
    "target.shape": {"calibration": "board_warp=bow"},
    "target.discs": {
        "target": "blobs circle_grid_detector disc_centroid=centroid disc_growth=growth disc_levels=levels "
        "disc_measurement=measurement ellipse hole_evidence lattice lattice_evidence"
    },
    "target.corners": {
        "target": "chessboard_detector corner_contrast=contrast corner_growth=growth corner_guidance=guidance "
        "corner_measurement=measurement corner_refinement=refinement saddle_fit"
    },
    "target.markers": {"target": "aruco aprilgrid_detector charuco_detector marker_board marker_detection=search"},
    "camera": {"storage": "camera_info camera_info_file=camera_info"},
    "calibration": {"report": "verdict=words"},
    "pipeline": {"commands": "resuming=found_so_far"},
}


def moved_modules() -> dict[str, str]:
    """Former name → new name, in full."""
    return {
        f"{_PACKAGE}{room}.{former}": f"{_PACKAGE}{place}.{new or former}"
        for place, rooms in _MOVED.items()
        for room, names in rooms.items()
        for former, _, new in (name.partition("=") for name in names.split())
    }


class _Finder:
    """Asked where no other finder knows a module; hands out the moved one in its place."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        if not name.startswith(_PACKAGE) or name not in moved_modules():
            return None
        return ModuleSpec(name, _Loader())  # type: ignore[arg-type]  # a loader need be no subclass of it


class _Loader:
    @staticmethod
    def create_module(spec: ModuleSpec) -> None:
        return None

    @staticmethod
    def exec_module(module: ModuleType) -> None:
        former, new = module.__name__, moved_modules()[module.__name__]
        warnings.warn(f"{former} is {new} now; the former name goes with the next version", DeprecationWarning, 2)
        sys.modules[former] = import_module(new)


def find_moved_modules() -> None:
    """Have imports of former names find the modules where they are now."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
