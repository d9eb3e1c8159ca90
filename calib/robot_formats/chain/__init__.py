"""Serial chains with any axes, and their five-parameter tables."""
