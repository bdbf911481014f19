"""What the package says, in a node's words: errors name parameters of functions, in backticks; a node has its own."""

from __future__ import annotations

import re

# Where a node's parameter is called otherwise than that of the function it is handed to.
_NODES = {"size": "width and height", "topics": "topic", "output": "output_directory", "camera": "camera_file"}
_NAMED = re.compile(r"`([a-z][a-z_]*)`")


def with_parameters(message: str) -> str:
    """The message with the node's parameters named."""
    return _NAMED.sub(lambda match: f"parameter {_NODES.get(match[1], match[1])}", message)
