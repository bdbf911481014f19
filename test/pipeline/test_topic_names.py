"""A recording's topics are named with or without their transport."""

from __future__ import annotations

import pytest
from bag_writers import COMPRESSED_IMAGE, images, messages, write_mcap

from fisheye_ep_calib import InputError, open_recording
from fisheye_ep_calib.pipeline.names import named_topics
from fisheye_ep_calib.storage.recording import choose_topics


@pytest.mark.parametrize("given", ["/front/image_raw", "/front/image_raw/compressed"])
@pytest.mark.parametrize("recorded", ["/front/image_raw", "/front/image_raw/compressed"])
def test_either_name_finds_what_was_recorded(given, recorded, tmp_path) -> None:
    kind = {"kind": COMPRESSED_IMAGE} if recorded.endswith("compressed") else {}
    path = write_mcap(tmp_path / "bag.mcap", messages(images(2), recorded, **kind) + messages(images(2), "/rear/image"))
    with open_recording(path) as recording:
        assert choose_topics(recording, (given,)) == (recorded,)
        assert named_topics(recording, {"front": given}) == {"front": recorded}
        assert named_topics(recording, [given]) == {"front": recorded}
        with pytest.raises(InputError, match="no topic /front/image"):
            choose_topics(recording, ("/front/image",))
