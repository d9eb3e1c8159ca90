"""Flat targets: the corner of a plate, and sets of planes in known relative positions."""
