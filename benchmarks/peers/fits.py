"""What others make of the same observations: an adapter each, which says how a point is seen by the fitted camera.

A fit is given ``Observations`` and a guess of the focal length in pixels, and gives back a ``Fitted``. One that fails
raises.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib import FisheyeCamera, Observations, calibrate

Project = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Fitted:
    """project: points (n, 3) in the camera frame, metres → pixels (n, 2), NaN where there are none.

    object_points (n, 3): the target as the fit takes it to be. rms_px: of its residuals, as it tells.
    """

    project: Project
    object_points: np.ndarray
    rms_px: float


def views_of(observations: Observations) -> list[tuple[np.ndarray, np.ndarray]]:
    """Point numbers (m,) and pixels (m, 2) of each image."""
    rows = [observations.image_index == image for image in np.unique(observations.image_index)]
    return [(observations.point_index[row], observations.pixels[row]) for row in rows]


def ours(model: str, **options) -> Callable[[Observations, float], Fitted]:
    def fit(observations: Observations, focal: float) -> Fitted:
        result = calibrate(observations, model, **options)
        points = result.object_points if result.board is None else result.board.points
        return Fitted(of_camera(result.camera), points, result.rms_px)

    return fit


def of_camera(camera: FisheyeCamera) -> Project:
    """As far out as the formula goes: held-out views may show more than was calibrated."""
    everywhere = replace(camera, theta_max=np.pi)

    def project(points: np.ndarray) -> np.ndarray:
        pixels, valid = everywhere.project(points)
        return np.where(valid[..., None], pixels, np.nan)

    return project


def opencv_fisheye(observations: Observations, focal: float) -> Fitted:
    """cv2.fisheye.calibrate from a good focal length. Its own projection is wrong beyond 90°: ours is taken."""
    import cv2

    flags = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_USE_INTRINSIC_GUESS") else cv2
    width, height = observations.image_size
    objects, pixels = _cv_lists(observations)
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    rms, matrix, distortion, _, _ = cv2.fisheye.calibrate(
        objects,
        pixels,
        observations.image_size,
        matrix,
        np.zeros((4, 1)),
        flags=flags.CALIB_USE_INTRINSIC_GUESS | flags.CALIB_RECOMPUTE_EXTRINSIC,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-6),
    )
    seen = equidistant(observations, matrix[[0, 1, 0, 1, 0], [0, 1, 2, 2, 1]], distortion.ravel())
    return Fitted(seen, observations.object_points, float(rms))


def equidistant(observations: Observations, linear: np.ndarray, radial: np.ndarray) -> Project:
    """Of fx, fy, cx, cy, skew and k1 … k4."""
    fx, fy, cx, cy, skew = linear.tolist()
    return of_camera(
        FisheyeCamera(
            observations.image_size, fx, fy, cx, cy, skew=skew, radial=tuple(radial.tolist()), theta_max=np.pi
        )
    )


def opencv_omnidir(observations: Observations, focal: float) -> Fitted:
    """cv2.omnidir.calibrate: Mei's model."""
    import cv2

    objects, pixels = _cv_lists(observations)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-8)
    rms, matrix, xi, distortion, *_ = cv2.omnidir.calibrate(
        objects, pixels, observations.image_size, None, None, None, 0, criteria
    )
    shift = float(np.ravel(xi)[0])
    k1, k2, p1, p2 = np.ravel(distortion)[:4]

    def project(points: np.ndarray) -> np.ndarray:
        on_sphere = points / np.linalg.norm(points, axis=-1, keepdims=True)
        depth = on_sphere[..., 2] + shift
        with np.errstate(all="ignore"):
            x, y = on_sphere[..., 0] / depth, on_sphere[..., 1] / depth
            square = x * x + y * y
            radial = 1 + k1 * square + k2 * square**2
            u = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
            v = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
        pixels = np.stack(
            [matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2], matrix[1, 1] * v + matrix[1, 2]], axis=-1
        )
        return np.where((depth > 0)[..., None], pixels, np.nan)

    return Fitted(project, observations.object_points, float(rms))


def _cv_lists(observations: Observations) -> tuple[list[np.ndarray], list[np.ndarray]]:
    views = views_of(observations)
    objects = [observations.object_points[names][None] for names, _ in views]
    return objects, [pixels[None] for _, pixels in views]


def mrcal(lens_model: str) -> Callable[[Observations, float], Fitted]:
    """mrcal as its mrcal-calibrate-cameras goes: a stereographic seed, the lens, then all with the board's warp."""

    def fit(observations: Observations, focal: float) -> Fitted:
        import mrcal as library

        cell, spacing = _lattice(observations.object_points)
        columns, rows = cell.max(axis=0) + 1
        views = views_of(observations)
        seen = np.zeros((len(views), rows, columns, 3))
        seen[..., 2] = -1.0
        for number, (names, pixels) in enumerate(views):
            seen[number, cell[names, 1], cell[names, 0]] = np.column_stack([pixels, np.ones(len(pixels))])
        indices = np.column_stack([np.arange(len(views)), np.zeros((len(views), 1), int), np.full((len(views), 1), -1)])
        indices = np.ascontiguousarray(indices, dtype=np.int32)
        sizes = np.array([observations.image_size], dtype=np.int32)
        core, _, frames = library.seed_stereographic(
            imagersizes=sizes,
            focal_estimate=focal,
            indices_frame_camera=np.ascontiguousarray(indices[:, :2]),
            observations=seen,
            object_spacing=spacing,
        )
        common = {
            "rt_cam_ref": None,
            "points": None,
            "observations_board": seen,
            "indices_frame_camintrinsics_camextrinsics": indices,
            "observations_point": None,
            "indices_point_camintrinsics_camextrinsics": None,
            "imagersizes": sizes,
            "calibration_object_spacing": spacing,
            "verbose": False,
        }
        frames = np.ascontiguousarray(frames)
        for free_core in (False, True):
            library.optimize(
                core,
                rt_ref_frame=frames,
                lensmodel="LENSMODEL_STEREOGRAPHIC",
                do_optimize_intrinsics_core=free_core,
                do_optimize_intrinsics_distortions=False,
                do_optimize_calobject_warp=False,
                do_apply_outlier_rejection=False,
                do_apply_regularization=False,
                **common,
            )
        count = library.lensmodel_num_params(lens_model)
        intrinsics = np.zeros((1, count))
        intrinsics[:, :4] = core[:, :4]
        if "SPLINED" not in lens_model:
            intrinsics[:, 4:] = (np.random.default_rng(0).random(count - 4) - 0.5) * 1e-6
        warp = np.zeros(2)
        for free_warp in (False, True):
            told = library.optimize(
                intrinsics,
                rt_ref_frame=frames,
                lensmodel=lens_model,
                calobject_warp=warp if free_warp else None,
                do_optimize_intrinsics_core="SPLINED" not in lens_model,
                do_optimize_intrinsics_distortions=True,
                do_optimize_calobject_warp=free_warp,
                do_apply_outlier_rejection=free_warp,
                do_apply_regularization=True,
                **common,
            )
        board = library.ref_calibration_object(columns, rows, spacing, calobject_warp=warp)[cell[:, 1], cell[:, 0]]

        def project(points: np.ndarray) -> np.ndarray:
            return library.project(np.ascontiguousarray(points), lens_model, intrinsics[0])

        return Fitted(project, board, float(np.sqrt(2) * told["rms_reproj_error__pixels"]))

    return fit


def _lattice(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Column and row (n, 2) of each point of a square lattice, and its spacing."""
    spacing = float(np.diff(np.unique(np.round(points[:, 0], 9))).min())
    return np.rint((points[:, :2] - points[:, :2].min(axis=0)) / spacing).astype(int), spacing


def ds_msp(observations: Observations, focal: float) -> Fitted:
    """ds_msp's Kannala–Brandt, plain least squares."""
    from ds_msp.calib import calibrate as library
    from ds_msp.models import KannalaBrandtModel

    width, height = observations.image_size
    start = KannalaBrandtModel(focal, focal, (width - 1) / 2, (height - 1) / 2, 0.0, 0.0, 0.0, 0.0)
    views = views_of(observations)
    objects = [observations.object_points[names] for names, _ in views]
    pixels = [measured for _, measured in views]
    seen = [np.ones(len(names), dtype=bool) for names, _ in views]
    told = library(start, objects, pixels, seen, robust="none", multi_start=False)
    model = told["model"]

    def project(points: np.ndarray) -> np.ndarray:
        measured, valid = model.project(points)
        return np.where(np.asarray(valid)[..., None], measured, np.nan)

    return Fitted(project, observations.object_points, float(told["rms_px"]))


def pycolmap(observations: Observations, focal: float) -> Fitted:
    """COLMAP's OPENCV_FISHEYE: the pose of each view by its P3P, then its bundle adjustment with the target held."""
    import pycolmap as library

    library.logging.minloglevel = library.logging.WARNING.value
    width, height = observations.image_size
    camera = library.Camera.create_from_model_id(1, library.CameraModelId.OPENCV_FISHEYE, focal, width, height)
    scene = library.Reconstruction()
    scene.add_camera_with_trivial_rig(camera)
    sightings: list[list[tuple[int, int]]] = [[] for _ in observations.object_points]
    for image, (names, pixels) in enumerate(views_of(observations), start=1):
        pixels = pixels + 0.5  # its first pixel has its centre at (0.5, 0.5)
        pose = library.estimate_and_refine_absolute_pose(pixels, observations.object_points[names], camera)
        if pose is None:
            continue
        scene.add_image_with_trivial_frame(
            library.Image(f"{image:05d}", keypoints=pixels, camera_id=1, image_id=image), pose["cam_from_world"]
        )
        for place, name in enumerate(names.tolist()):
            sightings[name].append((image, place))
    for point, seen in zip(observations.object_points, sightings, strict=True):
        if seen:
            scene.add_point3D(point, library.Track([library.TrackElement(*each) for each in seen]))
    options = library.BundleAdjustmentOptions()
    options.refine_points3D, options.refine_principal_point, options.print_summary = False, True, False
    solver = options.ceres.solver_options
    solver.num_threads, solver.max_num_iterations = 1, 200
    included = library.BundleAdjustmentConfig()  # its shortcut would hold two poses, as if the target could move
    for image in scene.images:
        included.add_image(image)
    library.create_default_bundle_adjuster(options, included, scene).solve()
    fx, fy, cx, cy, *radial = scene.cameras[1].params
    project = equidistant(observations, np.array([fx, fy, cx - 0.5, cy - 0.5, 0.0]), np.array(radial))
    missed = [
        project(observations.object_points[names] @ pose[:, :3].T + pose[:, 3]) - pixels
        for image, (names, pixels) in enumerate(views_of(observations), start=1)
        if image in scene.images
        for pose in [scene.images[image].cam_from_world().matrix()]
    ]
    rms = np.sqrt(2 * np.nanmean(np.concatenate(missed) ** 2))
    return Fitted(project, observations.object_points, float(rms))


PEERS: dict[str, Callable[[Observations, float], Fitted]] = {
    "this, auto": ours("auto"),
    "this, ep_odd, flat board": ours("ep_odd"),
    "this, kannala, flat board": ours("kannala"),
    "mrcal CAHVORE": mrcal("LENSMODEL_CAHVORE_linearity=0.0"),
    "mrcal OPENCV8": mrcal("LENSMODEL_OPENCV8"),
    "mrcal splined 16²": mrcal("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=16_fov_x_deg=170"),
    "OpenCV fisheye": opencv_fisheye,
    "OpenCV omnidir": opencv_omnidir,
    "ds_msp Kannala–Brandt": ds_msp,
    "COLMAP OPENCV_FISHEYE": pycolmap,
}
