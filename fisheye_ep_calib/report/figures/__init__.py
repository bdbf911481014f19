"""Figures of a report, each a function from plain data to an SVG text."""
