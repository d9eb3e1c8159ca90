"""Markup of the step Model."""
