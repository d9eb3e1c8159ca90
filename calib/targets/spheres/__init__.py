"""Finders of spheres: candidates in a scan, the centre from all points of the cap, reasons to refuse a candidate."""
