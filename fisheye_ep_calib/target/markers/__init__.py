"""Finding square markers and the corners that they name."""
