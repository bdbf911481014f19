"""The version, as it was installed: setup.py takes it from package.xml, the one place where it is written."""

from __future__ import annotations

from importlib import metadata

PACKAGE = "fisheye_ep_calib"


def _installed() -> str:
    try:
        return metadata.version(PACKAGE)
    except metadata.PackageNotFoundError:
        return "(not installed)"


__version__ = _installed()
