"""Robot programs: point lists, programs that measure, and programs whose targets are corrected."""
