"""Bags, image folders, observation files and camera files: everything that is read from or written to disk."""
