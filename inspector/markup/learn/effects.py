"""HTML of the tab Learn: the model's state, the ranking, the chosen effect, the verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence

from calib.calibration.noise_level import noise_level
from calib.diagnosis.advice import Advice
from calib.diagnosis.decision_rules import is_convincing
from calib.diagnosis.effect_selection import SelectedEffect
from calib.diagnosis.moves import AddCurves, AddEffect, DropEffect, LeaveOutPoses, ShapeNoise
from calib.diagnosis.result import Diagnosis
from calib.planning.discrimination import NextPoses
from calib.present import html, numbers
from calib.present.blocks import Section, Verdict, spans
from calib.present.colours import VERDICT_COLOURS
from calib.present.diagnosis import HOW, reasons
from calib.present.effects import not_testable
from calib.present.references import Names
from calib.present.verdict import advice as advice_words
from calib.present.verdict import residual_of, verdict
from calib.screening.candidates import Candidate, Screening, Untestable
from inspector.markup.parts import elements
from inspector.markup.parts.links import linked
from inspector.markup.parts.palette import BAD, GOOD, NEUTRAL, PROPOSAL
from inspector.session.session import Session, StepErrors
from inspector.session.transitions import LEFT_OUT, TAKEN_IN

NOT_YET = "Not calibrated yet: the model is fitted when the search has ended. The tab Fit says what it lacks."
SMALL = 0.01  # share of an error below which a change of it counts as none
LOOK_CLOSER = " Look at it in the tab Where it fails; an effect of your own can be tested with --effects-file."


def named(screening: Screening, name: str) -> Candidate | None:
    """Candidate by its name; None where no candidate has it (the effect may be in the model already)."""
    return next((c for c in screening.candidates if c.name == name), None)


def state_html(session: Session, undo: int, redo: int) -> str:
    """HTML on the model: its effects, its errors, and whether the last change helped."""
    if session.calibration is None or not session.history:
        return elements.note(NOT_YET)
    last = session.history[-1]
    test = last.test_rmse_mm
    level = noise_level(session.calibration)
    floor, undeclared = level.floor_mm, "" if level.is_declared else ", not declared"
    rows: list[tuple[str, object]] = [
        (
            "model",
            linked(" + ".join(["link errors", *map(effect_label, session.effects)]), Names.of(session.dataset)),
        ),
        ("training 3D RMSE", f"{numbers.column_mm(last.train_rmse_mm)} mm"),
        ("test 3D RMSE", f"{numbers.column_mm(test)} mm" if math.isfinite(test) else "no test poses"),
        (
            f"{level.name}, 3D",
            "not declared" if floor is None else f"{numbers.column_mm(floor)} mm{undeclared}",
        ),
        ("changes to undo · redo", f"{undo} · {redo}"),
    ]
    sentence, colour = last_change(session.history)
    return elements.facts(rows) + (elements.alert(sentence, colour=colour) if sentence else "")


def last_change(history: Sequence[StepErrors]) -> tuple[str, str]:
    """Phrase on whether the last change of the model helped, with a colour."""
    if len(history) < 2:
        return "", NEUTRAL
    old, new = history[-2:]
    tested = math.isfinite(old.test_rmse_mm) and math.isfinite(new.test_rmse_mm)
    before, after = (old.test_rmse_mm, new.test_rmse_mm) if tested else (old.train_rmse_mm, new.train_rmse_mm)
    of = "test error" if tested else "training error (there are no test poses)"
    figures = f"{numbers.column_mm(before)} → {numbers.column_mm(after)} mm"
    if not (before > 0 and math.isfinite(after)):
        return "", NEUTRAL
    share = after / before - 1
    if new.label.startswith((LEFT_OUT, TAKEN_IN)):  # of other poses than before, so neither better nor worse
        return f"{new.label}: the {of} is {figures}, of the poses that count now.", NEUTRAL
    adds = not new.label.startswith("−")
    if abs(share) < SMALL:
        more = "It does not help; Undo takes it out again." if adds else "It was not needed."
        return f"{new.label}: the {of} hardly changed, {figures}. {more}", NEUTRAL
    if share < 0:
        return f"{new.label}: the {of} fell by {-100 * share:.0f} %, {figures}.", GOOD
    more = "It does not help; Undo takes it out again." if adds else "It was needed; Undo brings it back."
    return f"{new.label}: the {of} rose by {100 * share:.0f} %, {figures}. {more}", BAD


SETTLE = "Plan the poses that settle it"
MORE = "Plan poses that tell more of the link errors"


def verdict_html(diagnosis: Diagnosis | None, next_poses: NextPoses | None) -> str:
    """HTML of a diagnosis' verdict in a line or two, and of the next plan."""
    if diagnosis is None:
        return ""
    more = LOOK_CLOSER if diagnosis.verdict == "unexplained" and diagnosis.learned is None else ""
    words = spans(residual_of(diagnosis), " Verdict: ", verdict(diagnosis), more)
    plan = ""
    if next_poses is not None:
        plan = elements.note(elements.Html(f"{elements.asking_link('settle', '', SETTLE, tab='Learn/Plan')}."))
    elif diagnosis.verdict in ("adequate", "named") and diagnosis.held_out_beyond_noise is not None:
        plan = elements.note(elements.Html(f"{elements.tab_link('Learn/Plan', MORE)}."))
    return html.panel([Verdict(words, VERDICT_COLOURS[diagnosis.verdict])]) + plan


def reasons_html(diagnosis: Diagnosis | None, next_poses: NextPoses | None) -> str:
    """HTML of the reasons for the verdict, a paragraph each."""
    return "" if diagnosis is None else html.panel([Section(HOW, reasons(diagnosis, next_poses))])


def advice_html(advice: Advice) -> str:
    """HTML on the residual and on the next move."""
    return html.panel([Verdict(advice_words(advice), PROPOSAL)])


def follow_label(advice: Advice) -> str:
    """Label of the button that makes the advised move."""
    match advice.move:
        case AddEffect():
            return f"Add {effect_label(SelectedEffect.of(advice.move.candidate))}"
        case AddCurves():
            return f"Add {effect_label(advice.move.diagnosis.steps[-1].selected[-1])}"
        case DropEffect():
            return f"Remove {advice.effect}"
        case LeaveOutPoses():
            return f"Leave out {', '.join(advice.move.poses)}"
        case ShapeNoise():
            return "Weigh the points by their noise"


def effect_label(effect: SelectedEffect) -> str:
    """Name of an effect with the joints that carry it."""
    joints = sorted({joint + 1 for m in effect.members if (joint := getattr(m, "joint", None)) is not None})
    if not joints:
        return effect.name
    return f"{effect.name} (joint{'s' if len(joints) > 1 else ''} {', '.join(map(str, joints))})"


def ranking_html(screening: Screening, chosen: str, own: set[str]) -> str:
    """HTML of the candidates with visible columns, best first, convincing ones ticked; the others by name only."""
    showing = [c for c in screening.candidates if c.members]
    names = [c.name for c in showing]
    silent = [c.name for c in screening.candidates if not c.members]
    before = screening.cv_rmse_mm
    rows = [
        (
            ("✓ " if is_convincing(c) else "") + c.name + (" (own)" if c.name in own else ""),
            f"{c.log_evidence:.1f}",
            numbers.relative_change(before, c.cv_rmse_mm),
            numbers.probability(c.p_holm),
        )
        for c in showing
    ]
    nothing = f"Nothing shows of {numbers.listing(silent)}." if silent else ""
    if not showing:
        none = "No effect of the catalogue can be tested with these data; the reasons are below."
        return elements.heading("What could be missing from this model") + elements.note(nothing or none)
    return (
        elements.heading("What could be missing from this model")
        + elements.table(
            ("effect", "evidence", "held-out error", "p"),
            rows,
            mark=names.index(chosen) if chosen in names else None,
        )
        + elements.note(
            "✓ The data speak for it: log evidence above 3 and p below 0.01 (Holm-corrected for the number of "
            "effects). A log Bayes factor below 3 over the next leaves it open. Held-out error: by how much the error "
            "falls where each pose is predicted from the others; it is "
            f"{numbers.column_mm(before)} mm per coordinate now. {nothing}"
        )
    )


def untestable_html(untestable: tuple[Untestable, ...]) -> str:
    """HTML on effects that these data cannot test, with reasons and remedies."""
    if not untestable:
        return ""
    return elements.heading("Cannot be tested with these data") + elements.bullets(not_testable(untestable))
