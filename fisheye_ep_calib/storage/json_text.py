"""Results as JSON."""

from __future__ import annotations

import json
import math
from typing import Any


def json_text(content: dict[str, Any]) -> str:
    """One line that every JSON reader takes: ASCII, NaN as null, infinities as the words inf and -inf."""
    return json.dumps(plain(content), allow_nan=False)


def plain(value: Any) -> Any:
    """Numbers that JSON cannot say become null (NaN) or the words inf and -inf."""
    if isinstance(value, dict):
        return {str(key): plain(element) for key, element in value.items()}
    if isinstance(value, list | tuple):
        return [plain(element) for element in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value
