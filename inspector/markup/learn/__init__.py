"""Markup of the step Learn."""
