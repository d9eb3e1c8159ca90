"""Figures of results, which `inspector.figures` offers by name."""
