"""Reading the YAML of somebody else: bounded, safe, and every fault in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from fisheye_ep_calib.errors import InputError, first_line

_MOST_BYTES = 1 << 20


def read_yaml(path: Path, kind: str) -> Any:
    """What a YAML file says, as plain data. kind: what it should be, for the error. Raises InputError."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path}: too large for a {kind} file")
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {kind} file {path}: {error.strerror or error}") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" (line {mark.line + 1})" if mark else ""
        raise InputError(f"{path} is not valid YAML{where}: {first_line(error)}") from None
