"""The 3D view: arrays in, viser nodes out."""
