"""Changes of a cell since a calibration, from a few check poses measured later."""
