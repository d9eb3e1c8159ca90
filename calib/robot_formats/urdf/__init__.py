"""URDF: read safely, found a serial arm in, and written by changing origins only."""
