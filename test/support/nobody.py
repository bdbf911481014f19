"""A listener of the live calibrator that wants to know nothing."""

from __future__ import annotations

from typing import Any


class Nobody:
    """Listens to nothing."""

    def calibrated(self, camera: str, outcome: Any) -> None: ...
    def rig_calibrated(self, outcome: Any) -> None: ...
    def wanted_pictures(self, camera: str) -> frozenset[str]:
        return frozenset()

    def pictures(self, camera: str, header: Any, pictures: Any) -> None: ...
