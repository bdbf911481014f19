"""Observations → camera, poses and the target's shape: first guess and bundle adjustment."""
