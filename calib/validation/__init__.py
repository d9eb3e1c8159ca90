"""Cross-validation, learning curve, and the check that passes or fails a dataset."""
