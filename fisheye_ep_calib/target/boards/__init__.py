"""The kinds of target: geometry, file, print."""
