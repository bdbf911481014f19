"""A frozen camera measured on views that it was not fitted to."""

from dataclasses import replace

import numpy as np
from counted_comparisons import Counted, counted

from fisheye_ep_calib import Observations
from fisheye_ep_calib.calibration.assessing.evaluation import evaluate_camera
from fisheye_ep_calib.calibration.evaluation_words import camera_variance
from fisheye_ep_calib.simulation import look_pose, observe, paper_camera, paper_poses, paper_target
from fisheye_ep_calib.simulation.truth import points_in_camera


def test_close_ups_of_a_strong_pupil_are_not_given_up() -> None:
    """At 40 mm the pose of rays through one point is so far off that it leaves points behind the caustic."""
    camera = replace(paper_camera(), model="ep_even", coefficients=(-0.004, -0.0005))
    target, rng = paper_target(), np.random.default_rng(0)
    poses = np.array(
        [
            look_pose(
                target,
                np.radians(rng.uniform(0, 80)),
                rng.uniform(0, 2 * np.pi),
                0.04,
                np.radians(rng.uniform(0, 40)),
                rng.uniform(0, 2 * np.pi),
                rng.uniform(0, 2 * np.pi),
            )
            for _ in range(30)
        ]
    )
    points = points_in_camera(poses, target.object_points)
    pixels, seen = camera.project(points)
    seen &= camera.incidence_angle(points) < np.radians(95)
    seen &= ((pixels > 0) & (pixels < np.array(camera.image_size) - 1)).all(axis=-1)
    image, point = np.nonzero(seen)
    views = Observations.create(target.object_points, image, point, pixels[image, point], camera.image_size)

    found = evaluate_camera(camera, views)

    assert not found.failed  # of the first poses alone, 20 would be
    assert found.rms_px < 1e-9
    assert set(found.images) | set(found.failed) == set(image)


def test_work_goes_with_the_sightings_not_with_images_times_sightings() -> None:
    """A plain lattice, so that the names of its points are judged too."""
    camera, target = paper_camera(), paper_target()
    poses = np.tile(paper_poses(target)[:10], (10, 1, 1))
    views = counted(replace(observe(camera, target, poses, 0.1, seed=0), mistakable=True))

    found = evaluate_camera(camera, views)
    camera_variance(found, views, camera, np.eye(len(camera.parameters)))

    assert len(found.images) == 100
    assert Counted.compared < 20 * len(views.pixels)  # a comparison with every image is 100 a sighting and pass
