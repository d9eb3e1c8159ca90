"""Colours of verdicts, one meaning each, distinguishable for colour-blind readers on light and dark pages."""

from __future__ import annotations

GOOD, DOUBT, BAD, NEUTRAL = "#009E73", "#E69F00", "#D55E00", "#8A8F98"
VERDICT_COLOURS = {
    # of diagnoses
    "adequate": GOOD,
    "named": GOOD,
    "ambiguous": DOUBT,
    "unexplained": BAD,
    "outliers": DOUBT,
    # of watched cells
    "unchanged": GOOD,
    "unclear": DOUBT,
    "changed": BAD,
}

# Causes of an error budget: the links, the effects in the order they were found, learned curves; then what is left.
LINKS, CURVES, NOISE, UNEXPLAINED = "#6568B9", "#BF4059", NEUTRAL, BAD
EFFECTS = ("#109C85", "#56B4E9", "#CC79A7", "#8C7340")
