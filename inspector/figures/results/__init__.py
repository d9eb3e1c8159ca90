"""Figures of results, available by name in `inspector.figures`."""
