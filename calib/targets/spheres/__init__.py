"""Spheres in a scan: where they may be, the centre from all points of the cap, what speaks against one."""
