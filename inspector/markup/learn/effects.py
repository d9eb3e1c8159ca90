"""The texts of the tab Learn as HTML: the model's state, the ranking, the chosen effect, the verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from calib.calibration.noise_check import noise_floor_mm
from calib.calibration.result import Calibration
from calib.diagnosis.advice import Advice, residual_summary
from calib.diagnosis.decision_rules import is_convincing
from calib.diagnosis.diagnose import AddCurves, SearchAgain, SearchWithNoise
from calib.diagnosis.effect_selection import SelectedEffect
from calib.diagnosis.moves import AddEffect, DropEffect
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.words.conclusion_text import advice_text, residual_summary_text, verdict_text
from calib.diagnosis.words.phrases import meaning, untestable_texts
from calib.diagnosis.words.text import reason_texts
from calib.effects.effect import (
    Description,
    Effect,
    Parameter,
    describe,
    family_name,
    full_name,
    parameters_by_name,
)
from calib.kinematics.robot import Robot
from calib.screening.candidates import Candidate, Screening, Untestable, Value
from calib.screening.pose_recommendation import DiscriminatingPose
from inspector.markup.parts import elements, numbers
from inspector.markup.parts.palette import BAD, DOUBT, GOOD, NEUTRAL, PROPOSAL
from inspector.session.session import Session, StepErrors

NOT_YET = "Not calibrated yet: the model is fitted when the search has ended. The tab Fit says what it lacks."
SMALL = 0.01  # share of an error below which a change of it counts as none
VERDICTS = {"adequate": GOOD, "named": GOOD, "ambiguous": DOUBT, "unexplained": BAD, "outliers": DOUBT}
LOOK_CLOSER = (
    " Look at it in the tab Where it fails; an effect of your own can be tested with --effects-file."
)


def named(screening: Screening, name: str) -> Candidate | None:
    """A candidate by its name; None where it is none (it may be in the model already)."""
    return next((c for c in screening.candidates if c.name == name), None)


def state_html(session: Session, undo: int, redo: int) -> str:
    """What is in the model, its figures, and whether the last change helped."""
    if session.calibration is None or not session.history:
        return elements.note(NOT_YET)
    last = session.history[-1]
    test = last.test_rmse_mm
    floor = noise_floor_mm(session.calibration)
    rows: list[tuple[str, object]] = [
        ("model", " + ".join(["link errors", *map(effect_label, session.effects)])),
        ("training 3D RMSE", f"{numbers.millimetres(last.train_rmse_mm)} mm"),
        ("test 3D RMSE", f"{numbers.millimetres(test)} mm" if math.isfinite(test) else "no test poses"),
        ("noise alone, 3D", "not declared" if floor is None else f"{numbers.millimetres(floor)} mm"),
        ("changes to undo · redo", f"{undo} · {redo}"),
    ]
    sentence, colour = last_change(session.history)
    return elements.facts(rows) + (elements.alert(sentence, colour=colour) if sentence else "")


def last_change(history: Sequence[StepErrors]) -> tuple[str, str]:
    """Whether the last change of the model helped, in words, with a colour."""
    if len(history) < 2:
        return "", NEUTRAL
    old, new = history[-2:]
    tested = math.isfinite(old.test_rmse_mm) and math.isfinite(new.test_rmse_mm)
    before, after = (old.test_rmse_mm, new.test_rmse_mm) if tested else (old.train_rmse_mm, new.train_rmse_mm)
    of = "test error" if tested else "training error (there are no test poses)"
    figures = f"{numbers.millimetres(before)} → {numbers.millimetres(after)} mm"
    if not (before > 0 and math.isfinite(after)):
        return "", NEUTRAL
    share = after / before - 1
    adds = not new.label.startswith("−")
    if abs(share) < SMALL:
        more = "It does not help; Undo takes it out again." if adds else "It was not needed."
        return f"{new.label}: the {of} hardly changed, {figures}. {more}", NEUTRAL
    if share < 0:
        return f"{new.label}: the {of} fell by {-100 * share:.0f} %, {figures}.", GOOD
    more = "It does not help; Undo takes it out again." if adds else "It was needed; Undo brings it back."
    return f"{new.label}: the {of} rose by {100 * share:.0f} %, {figures}. {more}", BAD


def verdict_html(diagnosis: Diagnosis | None) -> str:
    """The verdict of a diagnosis, in a line or two."""
    if diagnosis is None:
        return ""
    left = residual_summary_text(residual_summary(diagnosis.residual_tests, diagnosis.calibration))
    either = numbers.listing(diagnosis.ambiguous_set, "or")
    verdict = verdict_text(diagnosis.explanation.verdict, tied=either)
    more = " What would tell them apart is said below." if diagnosis.verdict == "ambiguous" else ""
    more += LOOK_CLOSER if diagnosis.verdict == "unexplained" and diagnosis.learned is None else ""
    return elements.alert(f"{left} Verdict: {verdict}{more}", colour=VERDICTS[diagnosis.verdict])


def reasons_html(diagnosis: Diagnosis | None) -> str:
    """All that led to the verdict, a paragraph each."""
    if diagnosis is None:
        return ""
    return elements.heading("How it was found") + "".join(
        map(elements.note, reason_texts(diagnosis.explanation))
    )


def advice_html(advice: Advice) -> str:
    """What is left, and what to do next."""
    return elements.alert(advice_text(advice.sentences), colour=PROPOSAL)


def follow_label(advice: Advice) -> str:
    """What the button beside an advice does."""
    match advice.move:
        case AddEffect():
            return f"Add {effect_label(SelectedEffect.of(advice.move.candidate))}"
        case AddCurves():
            return f"Add {effect_label(advice.move.found.steps[-1].selected[-1])}"
        case DropEffect():
            return f"Remove {advice.effect}"
        case SearchAgain():
            return f"Leave out {', '.join(advice.move.poses)}"
        case SearchWithNoise():
            return "Weigh the points by their noise"


def effect_label(effect: SelectedEffect) -> str:
    """An effect with the joints that carry it."""
    joints = sorted({joint + 1 for m in effect.members if (joint := getattr(m, "joint", None)) is not None})
    if not joints:
        return effect.name
    return f"{effect.name} (joint{'s' if len(joints) > 1 else ''} {', '.join(map(str, joints))})"


def ranking_html(screening: Screening, chosen: str, own: set[str]) -> str:
    """The candidates of which something shows, the best first, convincing ones ticked; the others by name."""
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
            "effects). A lead of less than 3 over the next leaves it open. Held-out error: by how much the error falls "
            "where each pose is predicted from the others; it is "
            f"{numbers.millimetres(before)} mm a coordinate now. {nothing}"
        )
    )


def chosen_html(
    name: str, candidate: Candidate | None, calibration: Calibration, cv_before_mm: float, *, own: bool
) -> str:
    """What the chosen effect is, its estimated parameters, what it may be confused with, how to be sure."""
    described = _description(name, candidate, calibration)
    out = elements.heading(f"Effect {name}")
    facts: list[tuple[str, object]] = []
    facts += [
        (what, text) for what, text in (("equation", described.equation), ("needs", described.needs)) if text
    ]
    if own:
        facts.append(("from", "your effects file"))
    if candidate is not None:
        alike = sorted(candidate.overlaps.items(), key=lambda item: -item[1])[:5]
        likeness = ", ".join(f"{n} {100 * s:.0f}\N{NO-BREAK SPACE}%" for n, s in alike)
        facts.append(("explains, of what is left", f"{100 * candidate.explained_share:.0f} %"))
        if candidate.members:
            now, then = numbers.millimetres(cv_before_mm), numbers.millimetres(candidate.cv_rmse_mm)
            by = numbers.relative_change(cv_before_mm, candidate.cv_rmse_mm)
            facts.append(("held-out error", f"{now} → {then} mm a coordinate ({by})"))
        facts.append(("could also be made by", likeness or "nothing else here"))
        if candidate.family.note:
            facts.append(("assumed", candidate.family.note))
    if described.confirm:
        facts.append(("to be sure, measure", described.confirm))
    out += elements.facts(facts)
    if candidate is None:
        return out
    if not candidate.values:
        return out + elements.note("Nothing of it shows in what is left over.")
    known = parameters_by_name(candidate.members)
    rows = [parameter_row(*known[v.name], v.value, v.sigma, calibration) for v in candidate.values]
    return (
        out
        + elements.table(("estimated", "value ± sigma", "that is"), rows, height="260px")
        + elements.note(
            "Linear estimates from what is left over; a fit with the effect in the model settles them. Below: each "
            "coordinate that is left over against what the effect would make of it. Points along the line speak for it."
        )
    )


def _description(name: str, candidate: Candidate | None, calibration: Calibration) -> Description:
    """What the class of a candidate, or of an effect in the model, says of it."""
    if candidate is not None:
        return candidate.family.description
    inside = next((effect for effect in calibration.model.effects if family_name(effect) == name), None)
    return describe(inside) if inside is not None else Description(name)


def fitted_html(calibration: Calibration, name: str) -> str:
    """The parameters of an effect that is in the model, as they were fitted."""
    known = parameters_by_name([e for e in calibration.model.effects if family_name(e) == name])
    rows = [
        parameter_row(*known[row["name"]], row["value"], row["sigma"], calibration)
        for row in calibration.to_frame().to_dict("records")
        if row["name"] in known
    ]
    return elements.note("It is in the model. Fitted together with everything else:") + elements.table(
        ("fitted", "value ± sigma", "that is"), rows, height="260px"
    )


def value_row(value: Value) -> tuple[str, str, str, str]:
    """A coefficient with its unit; the family's name is in the heading."""
    return value.name.partition(".")[2] or value.name, f"{value.value:.3g}", f"{value.sigma:.1g}", value.unit


def parameter_row(
    effect: Effect, parameter: Parameter, value: float, sigma: float, calibration: Calibration
) -> tuple[str, str, elements.Html]:
    """A parameter with its unit, what it is and means on the arm; the family's name is in the heading."""
    short = full_name(effect, parameter).partition(".")[2]
    unit = "" if parameter.unit == "1" else parameter.unit
    means = ": ".join(filter(None, (parameter.doc, meaning(effect, parameter, value, calibration)))) or "–"
    return short, f"{value:.3g} ± {sigma:.1g} {unit}".strip(), elements.wrapping(means)


def next_html(
    name: str, rival: str, poses: Sequence[DiscriminatingPose], robot: Robot, noise_mm: float
) -> str:
    """The poses at which an effect and its nearest rival differ most."""
    if not poses:
        return ""
    rows = [
        (
            ", ".join(f"{v:.0f}" for v in np.where(robot.is_revolute, np.degrees(pose.q), pose.q)),
            numbers.length(pose.separation_mm),
        )
        for pose in poses
    ]
    best = max(pose.separation_mm for pose in poses)
    enough = (
        "One measurement there tells them apart."
        if best > 4.0 * noise_mm
        else f"That is little beside the noise of {numbers.length(noise_mm)} a coordinate: measure there several times."
        if math.isfinite(noise_mm)
        else ""
    )
    units = "°" if robot.is_revolute.all() else "° (mm for prismatic joints)"
    return (
        elements.heading(f"To tell {name} from {rival}, measure here")
        + elements.table((f"joints, {units}", "they differ by"), rows)
        + elements.note(
            f"Fitted each by itself, the two put the tool farthest apart at these poses, of those within the range "
            f"measured. {enough}"
        )
    )


def untestable_html(untestable: tuple[Untestable, ...]) -> str:
    """What these data cannot test, why, and what would help."""
    if not untestable:
        return ""
    return elements.heading("Cannot be tested with these data") + elements.bullets(
        untestable_texts(untestable)
    )
