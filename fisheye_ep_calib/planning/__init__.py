"""What to look at next: which image of a recording, which view of the target."""
