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
