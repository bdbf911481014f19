"""Calibrating from a stream of images: what the live node does, without ROS."""
