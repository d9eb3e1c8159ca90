"""The jig's corner from plane groups, with its covariance (Jang 2025, eq 2): faces, intersection, refinement."""
