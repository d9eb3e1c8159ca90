"""Cameras: the lens, boards of known corners, what an image shows of one, and the board's pose with its covariance."""
