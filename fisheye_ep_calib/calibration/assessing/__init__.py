"""What a calibration is worth: uncertainty, findings, evaluation on other data, what a single viewpoint loses."""
