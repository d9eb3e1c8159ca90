"""What later measurements of a cell say, as rows of tables and as HTML for the tab Watch."""

from __future__ import annotations

from collections.abc import Sequence

from calib.display.colours import VERDICT_COLOURS
from calib.monitoring.change_tests import Found
from calib.monitoring.control_chart import shown_size
from calib.monitoring.iso9283 import CAVEAT, PoseFigures
from calib.monitoring.watch import Watched
from inspector.markup.parts import elements, numbers

EACH = ("", "date", "", "what changed", "error, mm", "limit, mm")
REPEATS = ("pose", "visits", "RP", "AP", "dAP", "dRP", "moved")
USUAL_NOTE = "Size ± sigma of each joint's zero and of the tool beside what is named, whether they changed or not."


def each_rows(seen: Sequence[Watched]) -> list[tuple[str, ...]]:
    """The rows of the table EACH, one a measurement; dates do not break."""
    return [
        (
            w.name, w.when.replace("-", "\u2011") or "–", w.verdict, numbers.typeset("; ".join(w.told)) or "–",
            numbers.millimetres(w.rmse_mm), numbers.millimetres(w.errors.limit_mm),
        )
        for w in seen
    ]  # fmt: skip


def usual_rows(seen: Sequence[Watched]) -> list[tuple[str, ...]]:
    """Each joint's zero and the tool, a column a measurement."""
    return [(_usual_name(found), *(_size(w.usual[k]) for w in seen)) for k, found in enumerate(seen[-1].usual)]


def _usual_name(found: Found) -> str:
    name = "tool" if found.joint is None else f"zero of joint {found.joint}"
    return f"{name}, {'°' if found.unit == 'rad' else found.unit}"


def _size(found: Found) -> str:
    size, sigma = shown_size(found)
    digits = max(0, min(4, int(-numbers.exponent(sigma)) + 1)) if sigma < 1e6 else 0
    return f"{size:+z.{digits}f} ± {sigma:.{digits}f}".replace("-", "−") if sigma < 1e6 else "not seen"


def repeat_rows(repeats: Sequence[PoseFigures]) -> list[tuple[str, ...]]:
    """The rows of the table REPEATS, mm; RP and AP of the last session, drift over all."""
    return [
        (
            p.pose, f"{sum(s.visits for s in p.sessions)} in {len(p.sessions)}",
            *(_mm(v) for v in (p.sessions[-1].rp_mm, p.sessions[-1].ap_mm, p.dap_mm, p.drp_mm, p.moved_mm)),
        )
        for p in repeats
    ]  # fmt: skip


def _mm(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def unseen_sentences(seen: Watched) -> list[str]:
    """What its poses could not have seen."""
    return [numbers.typeset(said) for said in seen.unseen_words]


def watch_html(seen: Sequence[Watched], repeats: Sequence[PoseFigures]) -> tuple[str, str]:
    """What stands over the control chart and what below it."""
    last = seen[-1]
    over = elements.alert(numbers.typeset(last.headline), colour=VERDICT_COLOURS[last.verdict])
    under = []
    if len(seen) > 1:
        rows = [(row[0], row[2], elements.wrapping(row[3]), *row[4:]) for row in each_rows(seen)]
        under.append(elements.heading("Each measurement") + elements.table((EACH[0], *EACH[2:]), rows))
    under.append(elements.heading(f"Every joint and the tool: {last.name}"))
    under += [elements.table(("", "by"), usual_rows([last])), elements.note(USUAL_NOTE)]
    if unseen := unseen_sentences(last):
        under.append(elements.heading("What these poses could not see") + elements.bullets(unseen))
    if repeats:
        under.append(elements.heading("Poses visited again, mm"))
        under += [elements.table(REPEATS, repeat_rows(repeats), height="220px"), elements.note(CAVEAT)]
    return over, "".join(under)
