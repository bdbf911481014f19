"""What --help says that is put together from registries."""

from __future__ import annotations

from fisheye_ep_calib.camera import LENS_EXTRAS
from fisheye_ep_calib.formats import FORMATS
from fisheye_ep_calib.pipeline.exporting import writable_formats


def test_export_lists_every_format_beside_what_it_is(command):
    listed = [line.split(maxsplit=1) for line in command("export", "--help").out.splitlines()]
    for name in writable_formats():
        assert [name, FORMATS[name].summary] in listed


def test_calibrate_says_what_every_extra_is(command):
    told = " ".join(command("calibrate", "--help").out.split())
    for name, extra in LENS_EXTRAS.items():
        assert f"--no-{name.replace('_', '-')} {extra.summary}" in told
