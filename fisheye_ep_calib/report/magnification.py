"""By how much small vectors are enlarged where they are shown."""

from __future__ import annotations

import numpy as np

_NICE = (1, 2, 5)


def magnification(lengths_px: np.ndarray, target_px: float) -> float:
    """A round factor by which the 95th percentile of lengths becomes about ``target_px`` long."""
    typical = float(np.quantile(lengths_px, 0.95)) if len(lengths_px) else 0.0
    if typical <= 0:
        return 1.0
    wanted = target_px / typical
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(decade * max(step for step in _NICE if step <= wanted / decade + 1e-9))
