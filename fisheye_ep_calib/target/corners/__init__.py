"""Finding and measuring saddle corners."""
