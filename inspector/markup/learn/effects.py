"""HTML of the tab What is missing: the model's state, the ranking, the chosen effect, the verdict."""

from __future__ import annotations

from collections.abc import Sequence

from calib.calibration.result import Calibration
from calib.diagnosis.advice import Advice
from calib.diagnosis.effect_selection import SelectedEffect
from calib.diagnosis.moves import AddCurves, AddEffect, DropEffect, LeaveOutPoses, ShapeNoise
from calib.diagnosis.result import Diagnosis
from calib.planning.discrimination import NextPoses
from calib.present.cause.candidates import (
    CANNOT_BE_TESTED,
    candidate_blocks,
    fitted_effect,
    held_out_sentence,
    nothing_shows,
    ranking_to_choose_from,
    ticks_sentence,
)
from calib.present.cause.diagnosis import HOW, reasons
from calib.present.cause.interventions import intervention_sections
from calib.present.cause.verdict import advice as advice_sentence
from calib.present.cause.verdict import residual_of, verdict
from calib.present.effects import not_testable, with_joints
from calib.present.fit.errors import last_change, state_of_model
from calib.present.fit.learned import offered_curves
from calib.rendering import html, numbers
from calib.rendering.blocks import Block, Bullets, Facts, Folded, Paragraph, Section, Verdict, plain, spans
from calib.rendering.colours import VERDICT_COLOURS
from calib.screening.candidates import Candidate, Screening, Untestable
from calib.screening.curves.smooth_joint_error import LEARNED
from inspector.markup.parts import elements
from inspector.markup.parts.palette import PROPOSAL
from inspector.session.session import Session

NOT_YET = "Not calibrated yet: the model is fitted when the search has ended. The tab Fit says what it lacks."
LOOK_CLOSER = " Look at it in the tab Where it fails; an effect of your own can be tested with --effects-file."
BELOW = (
    "Below: the residual of each training point, per coordinate, over what the effect would make of it. Points along "
    "the line speak for it."
)
MOST_NAMED = 4  # poses on a button
SETTLE = "Plan the poses that settle it"
MORE = "Plan poses that determine the link errors better"


def named(screening: Screening, name: str) -> Candidate | None:
    """Candidate by its name; None where no candidate has it (the effect may be in the model already)."""
    return next((c for c in screening.candidates if c.name == name), None)


def state_html(session: Session, undo: int, redo: int) -> str:
    """HTML on the model: its effects, its errors, and whether the last change helped."""
    if session.calibration is None or not session.history:
        return elements.note(NOT_YET)
    state = state_of_model(session.history, session.effects, session.calibration)
    change = last_change(session.history)
    steps = ("changes to undo · redo", f"{undo} · {redo}")
    return html.panel([Facts([*state.pairs, steps]), *([] if change is None else [change])])


def verdict_html(diagnosis: Diagnosis | None, next_poses: NextPoses | None) -> str:
    """HTML of a diagnosis' verdict in a line or two, and of the next plan."""
    if diagnosis is None:
        return ""
    more = LOOK_CLOSER if diagnosis.verdict == "unexplained" and diagnosis.learned is None else ""
    words = spans(residual_of(diagnosis), " Verdict: ", verdict(diagnosis), more)
    plan = ""
    if next_poses is not None:
        plan = elements.note(elements.Html(f"{elements.tab_link('Learn/Plan', SETTLE, ask='settle')}."))
    elif diagnosis.verdict in ("adequate", "named") and diagnosis.held_out_beyond_noise is not None:
        plan = elements.note(elements.Html(f"{elements.tab_link('Learn/Plan', MORE)}."))
    return html.panel([Verdict(words, VERDICT_COLOURS[diagnosis.verdict])]) + plan


def reasons_html(diagnosis: Diagnosis | None, next_poses: NextPoses | None) -> str:
    """HTML of the reasons for the verdict, a paragraph each."""
    if diagnosis is None:
        return ""
    return html.panel([Section(HOW, reasons(diagnosis, next_poses)), *intervention_sections(diagnosis)])


def advice_html(advice: Advice) -> str:
    """HTML on the residual and on the advised change of the model."""
    return html.panel([Verdict(advice_sentence(advice), PROPOSAL)])


def follow_label(advice: Advice) -> str:
    """Label of the button that makes the advised change of the model."""
    match advice.move:
        case AddEffect():
            name = plain(with_joints(SelectedEffect.of(advice.move.candidate)))
            return f"Put {name} in place of {advice.move.instead_of}" if advice.move.instead_of else f"Add {name}"
        case AddCurves():
            return f"Add {plain(with_joints(advice.move.diagnosis.steps[-1].selected[-1]))}"
        case DropEffect():
            return f"Remove {advice.effect}"
        case LeaveOutPoses():
            return leave_out_label(advice.move.poses)
        case ShapeNoise():
            return "Weigh the points by their noise"


def leave_out_label(poses: Sequence[str]) -> str:
    """Label of a button that leaves poses out: "Leave out p33 and p46"."""
    return f"Leave out {numbers.listing(numbers.first_of(poses, MOST_NAMED))}"


def ranking_html(session: Session, chosen: str) -> str:
    """HTML of the candidate effects that explain part of the residual, as rows to click, and of the others' names."""
    screening = session.screening
    if screening is None:
        return ""
    own = {family.name for family in session.user_effects}
    likely = None if session.diagnosis is None else session.diagnosis.told_probabilities
    blocks = ranking_to_choose_from(
        screening, passed_over=session.left_to_curves, chosen=(chosen,), own=own, likely=likely
    )
    notes = f"{ticks_sentence()} {held_out_sentence(screening)} {nothing_shows(screening)}"
    return html.panel(
        [
            Section("What could be missing: click an effect to choose it", blocks),
            Folded("What the columns mean", [Paragraph(notes)]),
        ]
    )


def chosen_html(name: str, session: Session, calibration: Calibration, screening: Screening, *, own: bool) -> str:
    """HTML on the chosen effect: description, estimated values, and fitted ones where it is in the model."""
    if name == LEARNED and session.curves is not None:
        return html.panel(offered_curves(session.curves, calibration))
    candidate = named(screening, name)
    blocks: list[Block] = candidate_blocks(name, candidate, calibration, screening.cv_rmse_mm, own=own)
    if candidate is not None and candidate.members:
        blocks.append(Paragraph(BELOW, soft=True))
    if name != LEARNED and any(added.name == name for added in session.effects):
        blocks += fitted_effect(name, calibration)
    return html.panel(blocks)


def untestable_html(untestable: tuple[Untestable, ...]) -> str:
    """HTML on effects that these data cannot test, with reasons and remedies."""
    return html.panel([Section(CANNOT_BE_TESTED, [Bullets(not_testable(untestable))])]) if untestable else ""
