"""Checks whether joints, points and robot.toml are consistent: signs, order, units, rows and robot tables."""
