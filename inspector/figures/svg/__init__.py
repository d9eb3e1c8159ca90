"""Figures as still SVG: for paper, and for readers without scripts."""
