"""Bags, image folders, observation files and camera files: all that is read from or written to disk."""
