"""What is told of planned check poses: the changes of a cell that they find and name, and the reason for each."""

from __future__ import annotations

from collections.abc import Sequence

from calib.extras.watch.change_models import change_label
from calib.extras.watch.check_outcome import ChangeReason, CheckOutcome, DetectableChange
from calib.present.moves.plans import ReasonTold, Told, reason_told, told
from calib.rendering import numbers
from calib.rendering.blocks import Block, Paragraph, Table


@told.register
def _of_checks(outcome: CheckOutcome) -> Told:
    return Told("to watch the cell", False, _promised(outcome), _detected(outcome.changes), _document(outcome))


@reason_told.register
def _by_changes(reason: ChangeReason) -> ReasonTold:
    return ReasonTold(", ".join(change_name(*key) for key in reason.changes) or "a little of everything")


def change_name(what: str, joint: int | None, parameter: str = "") -> str:
    """Name of a kind of change of a cell: "zero of joint 3", "length a2", "tool"."""
    if parameter and what in ("length", "angle"):
        return f"{what} {parameter}"
    noun = "zero" if what == "joint_zero" else what
    return noun if joint is None else f"{noun} of joint {joint}"


def _detected(changes: Sequence[DetectableChange]) -> list[str]:
    fixed = [change_name(*c.key) for c in changes if c.size is not None and not c.scanner_free]
    never = [change_name(*c.key) for c in changes if c.size is None]
    turning = "seen only where the scanner did not move, since turning it looks the same"
    return [
        *([f"{turning}: {', '.join(fixed)}"] if fixed else []),
        *([f"not found by any pose, as it hardly moves the target: {', '.join(never)}"] if never else []),
        *(["each pose measured twice lowers the sizes by nearly a third, four times by a half"] if changes else []),
    ]


def _promised(outcome: CheckOutcome) -> list[Block]:
    """Blocks with the sizes of changes that check poses find and name."""
    rows = [
        (
            change_name(*c.key),
            numbers.size(c.size, c.unit),
            "never" if c.named is None else numbers.size(c.named, c.unit),
            "never" if c.alone is None else numbers.size(c.alone, c.unit),
            "–" if c.rival is None else change_name(*c.rival),
        )
        for c in outcome.changes
        if c.size is not None
    ]
    words = (
        "19 times of 20 a change is found from the first size on (something changed), named from the second (it and "
        "no other), and named alone from the third (nothing else is said to be as likely), beside all that watch "
        "tests; a shift of the tool is found in its worst direction, and named in one drawn at random."
    )
    head = ("change", "found from", "named from", "named alone from", "looks most like")
    return [Table(head, rows, left=(0, 4)), Paragraph(words, soft=True)] if rows else []


def _document(outcome: CheckOutcome) -> dict[str, object]:
    return {
        "check": [
            {
                "what": c.key[0], "joint": c.key[1], "unit": c.unit, "found_from": c.size, "named_from": c.named,
                "alone_from": c.alone, "rival": None if c.rival is None else change_label(*c.rival),
            }
            for c in outcome.changes
        ]
    }  # fmt: skip
