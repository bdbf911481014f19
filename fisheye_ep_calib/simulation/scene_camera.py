"""What a scene asks of a camera."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike


class SceneCamera(Protocol):
    """A FisheyeCamera, or anything else that projects: see there for shapes and units."""

    @property
    def image_size(self) -> tuple[int, int]: ...

    def project(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray]: ...

    def project_with_jacobian(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]: ...

    def unproject(self, pixels: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...
