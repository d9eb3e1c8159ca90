"""Joint targets that bring the real arm where the nominal one should be."""
