"""Solids of an arm, its jig and its surroundings, and their distances from each other and from lines of sight."""
