"""What a scene asks of a camera."""

from __future__ import annotations

from typing import Protocol

import numpy as np


class SceneCamera(Protocol):
    """A FisheyeCamera, or anything else that projects: see there for shapes and units."""

    @property
    def image_size(self) -> tuple[int, int]: ...

    def project(self, points) -> tuple[np.ndarray, np.ndarray]: ...

    def project_with_jacobian(self, points) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]: ...

    def unproject(self, pixels) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...
