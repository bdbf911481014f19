"""Commands in this process, in an empty folder."""

from __future__ import annotations
