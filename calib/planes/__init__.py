"""Plane groups of a scan (Jang 2025, sections 2.2 and 2.3): normals, filters, clustering, robust plane fits."""
