"""Presentation of the differences between two calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from calib.calibration.evaluation import Evaluation
from calib.calibration.model_versions import LINKS, NOMINAL
from calib.present import names
from calib.present.results import document, own_fields, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Paragraph, Presentation, Section, Table, Verdict
from calib.rendering.colours import DOUBT, GOOD
from calib.validation.comparison import ALPHA, CameraShift, Comparison, ParameterChange, ParameterDifference

_MANY = 2.0  # times the declared noise, from which a fit is said to leave much
_AT = {"flange": "on the flange", "base": "in the room"}
APART = 2.0  # sigmas from which a parameter is listed as different


@presentation.register
def _comparison(compared: Comparison) -> Presentation:
    return Presentation(
        " and ".join(compared.names),
        comparison_head(compared),
        [Section("Errors", [errors(compared)], brief=True), Section("Parameters", parameters(compared), brief=True)],
    )


def comparison_head(compared: Comparison) -> list[Block]:
    """Blocks with the differences of two calibrations, and the effects that are in one of the models only."""
    only = [
        f"Only in the model of {name}: {numbers.listing(effects)}."
        for name, effects in zip(compared.names, compared.only_in, strict=True)
        if effects
    ]
    head: list[Block] = [Verdict(comparison_verdict(compared), DOUBT if compared.differs else GOOD)]
    left = map(misfit_sentence, compared.names, compared.times_noise)
    cameras = map(camera_sentence, compared.cameras)
    return [*head, *(Paragraph(sentence) for sentence in (*cameras, *only, *left) if sentence)]


def camera_sentence(camera: CameraShift) -> str:
    """Sentence on whether a camera stands elsewhere, and by how much."""
    named = f"The camera{f' of {camera.setup}' if camera.setup else ''} {_AT[camera.parent]}"
    by = f"{numbers.length(float(np.linalg.norm(camera.shift_mm)))} and {float(np.linalg.norm(camera.turn_deg)):.2g}°"
    if camera.p_same < ALPHA:
        return f"{named} stands elsewhere, by {by} ({numbers.probability(camera.p_same)} by chance)."
    return f"{named} stands where it was: it differs by {by}, which the noise explains."


def misfit_sentence(name: str, times_noise: float | None) -> str:
    """Sentence on a fit that leaves many times the declared noise, in which small changes hide; "" for any other."""
    if times_noise is None or times_noise < _MANY:
        return ""
    return (
        f"The fit of {name} leaves {numbers.times(times_noise)} the declared noise: what it misses counts as "
        "uncertainty here, and small changes hide in it. What `diagnose` finds can be taken into the fit by --effect "
        "and --add."
    )


def comparison_verdict(compared: Comparison) -> str:
    """Verdict on the differences between two calibrations, in a sentence or two."""
    where = (
        f"The tool point moves by {numbers.length(compared.rms_mm)} RMS, at the most by "
        f"{numbers.length(compared.largest_mm)} at {compared.largest_pose}"
    )
    one, other = compared.names
    if not compared.changes:
        return (
            f"No link parameter differs between {one} and {other} beyond the noise (probability of this much by "
            f"chance: {numbers.probability(compared.p_same)}). {where}, which the noise explains."
        )
    changes = [_parameter_change(change) for change in compared.changes]
    listed = changes[0] if len(changes) == 1 else f"{'; '.join(changes[:-1])}; and {changes[-1]}"
    if compared.p_rest < ALPHA:
        return f"{one} and {other} differ in many link parameters, most of all in {listed}. {where}."
    return f"From {one} to {other} changed: {listed}. {where}."


def _parameter_change(change: ParameterChange) -> str:
    joint = change.name.removeprefix("theta")
    name = f"the zero of joint {joint} ({change.name})" if joint != change.name and joint.isdigit() else change.name
    by = numbers.with_sigma(change.size, change.sigma, change.unit, sign=True)
    return f"{name} by {by}{or_confounded(change.alike)}"


def or_confounded(others: Sequence[str]) -> str:
    """Words on what cannot be discriminated from a change: ", or a2, which are indistinguishable ..."; "" for none."""
    return f", or {numbers.listing(others, 'or')}, which are indistinguishable at these poses" if others else ""


def errors(compared: Comparison) -> Table:
    """Table of 3D RMSE before and after of both calibrations, of training and test poses."""
    rows = [
        (f"{name}, {names.role(role)}", *(numbers.column_mm(_rmse_mm(figures, role)) for figures in stages))
        for name, stages in zip(compared.names, compared.errors, strict=True)
        for role in ("train", "test")
        if _rmse_mm(stages[1], role) is not None
    ]
    return Table(("3D RMSE, mm", NOMINAL, LINKS), rows)


def _rmse_mm(evaluation: Evaluation, role: str) -> float | None:
    figures = evaluation.train if role == "train" else evaluation.test
    return None if figures is None else figures.rmse_mm


def parameters(compared: Comparison) -> list[Block]:
    """Table of the parameters that differ by two sigmas or more, the most significant first."""
    apart = sorted((p for p in compared.parameters if abs(p.z) >= APART), key=lambda p: -abs(p.z))
    if not apart:
        return [Paragraph(f"No single parameter differs by {APART:g} sigma or more.")]
    columns = ("parameter", *compared.names, "difference ± sigma", "unit")
    caption = f"parameters that differ by {APART:g} sigma or more"
    return [
        Table(columns, [_difference(p) for p in apart], caption=caption, left=(0, 4), height="300px"),
        Paragraph(
            "Of many parameters one in twenty is beyond two sigma by chance, and a real change of one moves those that "
            "it is correlated with; the sentence above accounts for both.",
            soft=True,
        ),
    ]


def _difference(p: ParameterDifference) -> tuple[str, ...]:
    (first, unit), (second, _) = (numbers.readable(value, p.unit) for value in p.values)
    by = numbers.with_sigma(p.difference, p.sigma, p.unit, sign=True).removesuffix(unit).rstrip()
    return (numbers.parameter_label(p.name), f"{first:z.6g}", f"{second:z.6g}", by, unit)


@document.register
def _comparison_document(compared: Comparison) -> dict[str, Any]:
    errors = [{"before": before, "after": after} for before, after in compared.errors]
    told = {"differs": compared.differs, "errors": errors, "explanation": comparison_verdict(compared)}
    return own_fields(compared) | told
