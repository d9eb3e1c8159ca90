"""Figures as static SVG, for print and for readers without scripts."""
