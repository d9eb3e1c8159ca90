"""Markup of the step Measure."""
