"""What is taken away from a calibration: the table that is best alone, and the full model as a file."""
