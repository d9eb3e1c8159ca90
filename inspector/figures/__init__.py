"""Plotly figures from arrays. No viser."""
