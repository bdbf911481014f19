"""Images without a target."""

import numpy as np

from fisheye_ep_calib.simulation.clutter import clutter_image


def test_clutter_repeats_varies_and_has_contrast():
    images = [clutter_image(seed, (320, 200)) for seed in range(12)]
    assert all(image.shape == (200, 320) and image.dtype == np.uint8 for image in images)
    assert np.array_equal(images[3], clutter_image(3, (320, 200)))
    assert not np.array_equal(images[3], images[4])
    assert min(image.std() for image in images) > 10
