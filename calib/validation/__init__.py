"""Cross-validation, learning curve, comparison of two calibrations, and the check that passes or fails a dataset."""
