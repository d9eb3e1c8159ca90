"""Reasons why many scans have no corner, in one sentence."""

from __future__ import annotations

from calib.measurement.measured_points import counted_reasons


def test_alike_reasons_are_counted_with_the_ranges_of_their_numbers_the_most_frequent_first() -> None:
    remedy = "turn the jig so that 3 faces are seen"
    two = {
        f"p{k}": f"two faces only, at {84 + k} deg to each other: found 2 planes ({500 - k} points); {remedy}"
        for k in range(7)
    }
    said = counted_reasons({"p90": "only 5 points on one of the faces; scan it finer"} | two | {"p91": "damaged"})
    assert said == (
        "7 of 9: two faces only, at 84 to 90 deg to each other: found 2 planes (494 to 500 points) "
        f"({remedy}); 1 of 9: only 5 points on one of the faces; 1 of 9: damaged"
    )
