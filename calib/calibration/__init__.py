"""Calibration of an arm from a dataset: the fit, errors before and after, uncertainty and plausibility."""
