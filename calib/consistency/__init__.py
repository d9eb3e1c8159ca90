"""Consistency of joints, points and robot.toml: signs, order, units, rows and robot tables."""
