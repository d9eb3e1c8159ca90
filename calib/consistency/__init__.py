"""Whether joints, points and robot.toml belong together: signs, order, units, rows and tables, before any physics."""
