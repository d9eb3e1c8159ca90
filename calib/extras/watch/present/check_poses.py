"""What is told of planned check poses: the changes of a cell that they find."""

from __future__ import annotations

from calib.extras.watch.change_models import change_label
from calib.extras.watch.watch_criterion import CheckOutcome
from calib.present.plans.plans import Told, told
from calib.rendering import numbers
from calib.rendering.blocks import Paragraph, Table


@told.register
def _of_checks(outcome: CheckOutcome) -> Told:
    found = [c for c in outcome.changes if c.size is not None]
    rows = [(change_label(c.what, c.joint), numbers.size(c.size or 0.0, c.unit)) for c in found]
    words = "19 times of 20 a change is found from this size on, the tool's in its worst direction; a name takes more."
    never = [change_label(c.what, c.joint) for c in outcome.changes if c.size is None]
    sentences = [
        *([f"not found by any pose, or taken for the instrument: {', '.join(never)}"] if never else []),
        *(["each pose measured twice lowers the sizes by nearly a third, four times by a half"] if found else []),
    ]
    table = [Table(("change", "found from"), rows, left=(0,)), Paragraph(words, soft=True)] if rows else []
    keys = [{"what": c.what, "joint": c.joint, "unit": c.unit, "found_from": c.size} for c in outcome.changes]
    return Told("to watch the cell", False, table, sentences, {"check": keys})
