"""Targets other than the jig's corner, found in scans: the protocol of a finder, and finders of spheres and more."""
