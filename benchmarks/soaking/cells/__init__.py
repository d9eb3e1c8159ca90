"""Random arms, calibrated and diagnosed, and the same arms told otherwise."""
