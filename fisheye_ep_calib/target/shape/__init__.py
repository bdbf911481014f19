"""What a target's points are in truth: its bow."""
