"""HTML of the tab Learn on one effect: description, parameters, and how to discriminate it from others."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from calib.calibration.result import Calibration
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
from calib.planning.discrimination import DiscriminatingPose
from calib.present import numbers
from calib.present.effects import meaning
from calib.present.names import joints_by_parameter
from calib.screening.candidates import Candidate, Value
from inspector.markup.parts import elements
from inspector.markup.parts.links import joint_asks


def chosen_html(
    name: str, candidate: Candidate | None, calibration: Calibration, cv_before_mm: float, *, own: bool
) -> str:
    """HTML on the chosen effect: description, estimated parameters, confounded effects, confirming experiment."""
    described = _description(name, candidate, calibration)
    out = elements.heading(f"Effect {name}")
    facts: list[tuple[str, object]] = []
    facts += [(what, text) for what, text in (("equation", described.equation), ("needs", described.needs)) if text]
    if own:
        facts.append(("from", "your effects file"))
    if candidate is not None:
        alike = sorted(candidate.overlaps.items(), key=lambda item: -item[1])[:5]
        likeness = ", ".join(f"{n} {100 * s:.0f}\N{NO-BREAK SPACE}%" for n, s in alike)
        facts.append(("explains, of what is left", f"{100 * candidate.explained_share:.0f} %"))
        if candidate.members:
            now, then = numbers.column_mm(cv_before_mm), numbers.column_mm(candidate.cv_rmse_mm)
            by = numbers.relative_change(cv_before_mm, candidate.cv_rmse_mm)
            facts.append(("held-out error", f"{now} → {then} mm per coordinate ({by})"))
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
    joints = joints_by_parameter(calibration.model.robot, candidate.members)
    asks = joint_asks(joints.get(v.name) for v in candidate.values)
    return (
        out
        + elements.table(("estimated", "value ± sigma", "that is"), rows, height="260px", asks=asks)
        + elements.note(
            "Linear estimates from what is left over; a fit with the effect in the model settles them. Below: each "
            "coordinate that is left over against what the effect would make of it. Points along the line speak for it."
        )
    )


def _description(name: str, candidate: Candidate | None, calibration: Calibration) -> Description:
    """Description of a candidate, or of an effect in the model, from the texts on its class."""
    if candidate is not None:
        return candidate.family.description
    inside = next((effect for effect in calibration.model.effects if family_name(effect) == name), None)
    return describe(inside) if inside is not None else Description(name)


def fitted_html(calibration: Calibration, name: str) -> str:
    """HTML of the fitted parameters of an effect in the model."""
    members = [e for e in calibration.model.effects if family_name(e) == name]
    known, joints = parameters_by_name(members), joints_by_parameter(calibration.model.robot, members)
    fitted = [row for row in calibration.to_frame().to_dict("records") if row["name"] in known]
    rows = [parameter_row(*known[row["name"]], row["value"], row["sigma"], calibration) for row in fitted]
    asks = joint_asks(joints.get(row["name"]) for row in fitted)
    return elements.note("It is in the model. Fitted together with everything else:") + elements.table(
        ("fitted", "value ± sigma", "that is"), rows, height="260px", asks=asks
    )


def value_row(value: Value) -> tuple[str, str, str, str]:
    """Table row of a coefficient with its unit; the family's name is in the heading."""
    return value.name.partition(".")[2] or value.name, f"{value.value:.3g}", f"{value.sigma:.1g}", value.unit


def parameter_row(
    effect: Effect, parameter: Parameter, value: float, sigma: float, calibration: Calibration
) -> tuple[str, str, elements.Html]:
    """Table row of a parameter: unit, description and meaning on the arm; the family's name is in the heading."""
    short = full_name(effect, parameter).partition(".")[2]
    unit = "" if parameter.unit == "1" else parameter.unit
    means = ": ".join(filter(None, (parameter.doc, meaning(effect, parameter, value, calibration)))) or "–"
    return short, f"{value:.3g} ± {sigma:.1g} {unit}".strip(), elements.wrapping(means)


def next_html(name: str, rival: str, poses: Sequence[DiscriminatingPose], robot: Robot, noise_mm: float) -> str:
    """HTML on the poses at which an effect and its nearest rival differ most."""
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
        else f"The noise is {numbers.length(noise_mm)} per coordinate: measure there several times."
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
