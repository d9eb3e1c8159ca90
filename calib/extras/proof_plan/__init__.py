"""Pairs of poses that prove a cause by a change of one condition: their choice, and how probable the proof is."""
