"""Targets with flat surfaces: a set of planes, a plate with a corner."""
