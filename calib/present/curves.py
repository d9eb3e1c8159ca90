"""Presentation of learned curves of the joints: sizes, short formulas, and curves that could be added."""

from __future__ import annotations

from calib.calibration.result import Calibration
from calib.effects.effect import describe
from calib.kinematics.robot import Robot
from calib.present import numbers
from calib.present.blocks import Block, Facts, Paragraph, Table, joint
from calib.present.residuals import input_title
from calib.screening.curves.fitted_curves import FittedCurve, fitted_curves, learned_members, shape_text
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.curves.smooth_joint_error import LEARNED, CurveModes

CURVES = ("joint", "over", "rms", "largest", "at", "known")
BAND_NOTE = (
    "Each joint's learned error over its input. Band: two sigmas by the fit's covariance, the prior in it; grey: not "
    "measured. What geometry can do too is shared between the two, so only the shape beyond that is sure."
)
_KNOWN_NOTE = "Known: how many of a curve's modes these data tell by themselves."
_READ_AS = {"deg": "°", "C": "°C"}


def input_label(curve: FittedCurve, robot: Robot) -> str:
    """A curve's input with its unit: "joint 1 angle, °"."""
    title = input_title(curve.input, robot)
    bare = title == curve.input and curve.input_unit  # a sum of two joints' angles
    return f"{title}, {read_unit(curve.input_unit)}" if bare else title


def read_unit(unit: str) -> str:
    """Unit in which a learned curve is presented to readers."""
    return _READ_AS.get(unit, unit)


def curve_blocks(calibration: Calibration) -> list[Block]:
    """Blocks on the learned curves of a model: explanation, table, and short formulas; [] without learned curves."""
    members = learned_members(calibration)
    if not members:
        return []
    equation = Paragraph(f"{LEARNED}: {members[0].equation}. It names no cause.")
    return [
        equation,
        curve_table(calibration),
        Paragraph(_KNOWN_NOTE, soft=True),
        *map(Paragraph, formulas(calibration)),
    ]


def curve_table(calibration: Calibration) -> Table:
    """Table with a row for each learned curve of a model."""
    curves = fitted_curves(calibration)
    return Table(CURVES, [_row(c) for c in curves], left=(0, 1), rows_select=[joint(c.joint + 1) for c in curves])


def _row(curve: FittedCurve) -> tuple[str, ...]:
    place, value = curve.largest
    at = numbers.signed(curve.input_scale * place, ".3g")
    return (
        str(curve.joint + 1),
        curve.input,
        f"{curve.scale * curve.rms:.2g} {curve.unit}",
        f"{numbers.signed(curve.scale * value, '+.2g')} {curve.unit}",
        f"{at} {read_unit(curve.input_unit)}".strip(),
        f"{curve.known}/{curve.parameters}",
    )


def formulas(calibration: Calibration) -> list[str]:
    """Sentences on learned curves that are short formulas: the terms in words, and the formula with its values."""
    return [
        f"Joint {curve.joint + 1}: {curve.shape}; {curve.formula}."
        for curve in fitted_curves(calibration)
        if curve.formula
    ]


def offered_curves(curves: LearnedCurves, calibration: Calibration) -> list[Block]:
    """Blocks on curves that can be added to a model, with their evidence."""
    described = describe(curves.members[0])
    facts: list[tuple[str, object]] = [
        ("equation", described.equation),
        ("needs", described.needs),
        ("log evidence, all together", f"{curves.log_evidence:.1f}"),
        ("to be sure, measure", described.confirm),
    ]
    rows = [
        (
            str(member.joint + 1),
            member.modes.input,
            f"a curve of {len(member.parameters)} modes"
            if isinstance(member.modes, CurveModes)
            else shape_text(member, calibration),
        )
        for member in curves.members
    ]
    selects = [joint(member.joint + 1) for member in curves.members]
    note = "No named effect explains what is left. The curves name no cause; add them to see them."
    return [
        Paragraph(f"Effect {LEARNED}", heading=True),
        Facts(facts),
        Table(("joint", "over", "learned"), rows, left=(0, 1, 2), rows_select=selects),
        Paragraph(note, soft=True),
    ]
