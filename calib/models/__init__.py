"""Files made from a calibration: the full model, and the robot table that fits best without effects."""
