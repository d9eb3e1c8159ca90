"""Which datasets of an arm are compared, and what of it the arm must answer for."""

from __future__ import annotations

from calib.extras.fleet.drift import Drift, consecutive
from calib.validation.cell_changes import Change
from tests.extras.fleet.rows import row


def test_each_dataset_is_held_against_the_last_fit_before_it() -> None:
    rows = [
        row("a1", serial="A", date="2026-01-01"),
        row("a2", serial="A", date="2026-02-01", verdict=""),  # check poses
        row("a3", serial="A", date="2026-03-01", verdict=""),
        row("a4", serial="A", date="2026-04-01"),
        row("a4b", serial="A", date="2026-04-01"),  # of the same day: neither is the earlier one
        row("a5", serial="A", date="2026-05-01"),
        row("b1", serial="B", date="2026-01-01"),
        row("b2", serial="B"),  # no date
        row("c1", date="2026-01-01"),  # no serial number
        row("c2", date="2026-02-01"),
        row("d1", serial="A", date="2026-06-01", robot="UR10"),  # another arm of the same number
    ]
    pairs = [(base.path, later.path) for base, later in consecutive(rows[::-1])]
    assert pairs == [("a1", "a2"), ("a1", "a3"), ("a1", "a4"), ("a1", "a4b"), ("a4b", "a5")]


def test_a_moved_scanner_and_what_is_unclear_are_not_of_the_arm() -> None:
    zero = Change("joint_zero", 2, "theta2", 0.001, 1e-5, "rad", 0.0, ())
    others = [Change(what, None, "", 3.0, 0.1, "mm", 0.0, ()) for what in ("scanner", "base", "jig", "noise")]

    def seen(verdict: str) -> Drift:
        return Drift("a", "b", verdict, (zero, *others), 1.0)

    assert seen("changed").of_the_arm
    assert not seen("unclear").of_the_arm
    assert not Drift("a", "b", "changed", tuple(others)).of_the_arm
