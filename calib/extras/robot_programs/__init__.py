"""Robot programs: point lists, trajectories, programs that measure, and programs whose targets are corrected."""
