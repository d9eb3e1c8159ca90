"""From plane groups to the corner with its covariance (Jang 2025, eq 2): face selection, intersection, refinement."""
