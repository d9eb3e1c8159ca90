"""Plans of poses to measure."""
