"""Cameras that see one target at the same time: where they are to each other."""
