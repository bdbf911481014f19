"""Figures and pages that show a calibration to a person. The core does not know them."""
