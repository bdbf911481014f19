"""Finding and measuring discs."""
