"""Nodes of the 3D view from arrays."""
