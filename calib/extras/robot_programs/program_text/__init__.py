"""Targets in existing robot programs: found with their places in the text, one module for each language."""
