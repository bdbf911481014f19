"""Images that are kept decoded, so that a second look does not decode them again."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from bag_writers import images, write_folder

from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.storage.sources.image_files import ImageFiles

PICTURES = images()


def test_kept_images_are_decoded_once_up_to_a_bound_that_workers_have_too(tmp_path, monkeypatch):
    write_folder(tmp_path / "front", PICTURES)
    decoded = []
    grey = ImageFiles.grey
    monkeypatch.setattr(ImageFiles, "grey", lambda *given: decoded.append(given[2].location) or grey(*given))
    with open_recording(tmp_path / "front") as recording:
        size = recording.frame("front", 0).image().nbytes
        with recording.keeping_decoded(2 * size):
            decoded.clear()
            first = [frame.image() for frame in recording.frames()]
            again = [frame.levels() for frame in recording.frames()]
            assert len(decoded) == 2 * len(PICTURES) - 2
            for one, other in zip(first, again, strict=True):
                np.testing.assert_array_equal(one, other)
            with pytest.raises(ValueError):
                first[0][0, 0] = 1
            decoded.clear()
            other_process = pickle.loads(pickle.dumps(recording))
            for _ in range(2):
                other_process.frame("front", 0).image()
            assert len(decoded) == 1
        decoded.clear()
        recording.frame("front", 0).image()
        assert len(decoded) == 1
