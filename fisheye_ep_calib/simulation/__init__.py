"""A scene with known truth: a camera, a target and poses become images, observations and bags."""

from fisheye_ep_calib.simulation.bag import StampedImage, write_bag
from fisheye_ep_calib.simulation.clutter import clutter_image
from fisheye_ep_calib.simulation.evaluation_set import EvaluationView, evaluation_set
from fisheye_ep_calib.simulation.poses import look_pose, paper_poses, random_poses
from fisheye_ep_calib.simulation.published_lenses import PUBLISHED_LENSES
from fisheye_ep_calib.simulation.ray_traced_camera import RayTracedCamera, laikin_camera, published_camera
from fisheye_ep_calib.simulation.rendering import Imaging, render
from fisheye_ep_calib.simulation.scene_camera import SceneCamera
from fisheye_ep_calib.simulation.scenes import paper_camera, paper_target
from fisheye_ep_calib.simulation.sequence import SimulatedCamera, View, render_views, simulate_rig, views_at
from fisheye_ep_calib.simulation.truth import disc_centroids, feature_pixels, observe

__all__ = [
    "PUBLISHED_LENSES",
    "EvaluationView",
    "Imaging",
    "RayTracedCamera",
    "SceneCamera",
    "SimulatedCamera",
    "StampedImage",
    "View",
    "clutter_image",
    "disc_centroids",
    "evaluation_set",
    "feature_pixels",
    "laikin_camera",
    "look_pose",
    "observe",
    "paper_camera",
    "paper_poses",
    "paper_target",
    "published_camera",
    "random_poses",
    "render",
    "render_views",
    "simulate_rig",
    "views_at",
    "write_bag",
]
