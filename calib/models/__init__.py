"""Files made of a calibration: the full model, and the table that is best without effects."""
