"""The page: its tabs, its state, its camera."""
