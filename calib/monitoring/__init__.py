"""The same cell measured again: what changed since a calibration, if anything."""
