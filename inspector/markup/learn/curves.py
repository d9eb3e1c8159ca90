"""What is said of learned curves: titles with units, the tables of those to be added and of those in the model."""

from __future__ import annotations

from calib.calibration.result import Calibration
from calib.effects.effect import describe
from calib.kinematics.robot import Robot
from calib.screening.curves.fitted_curves import FittedCurve, fitted_curves, shape_text
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.curves.smooth_joint_error import LEARNED, CurveModes
from inspector.markup.learn.residuals import input_title
from inspector.markup.parts import elements
from inspector.markup.parts.links import joint_asks

COLUMNS = ("joint", "over", "rms", "largest", "at", "known")
BAND_NOTE = (
    "Each joint's learned error over its input. Known: of its modes, those that the data tell by themselves. Band: two "
    "sigmas by the fit's covariance, the prior in it; grey: not measured. What geometry can do too is shared between "
    "the two, so only the shape beyond that is sure."
)
_SHOWN = {"deg": "°", "C": "°C"}


def shown_unit(unit: str) -> str:
    """A curve's unit as the page writes it."""
    return _SHOWN.get(unit, unit)


def input_label(curve: FittedCurve, robot: Robot) -> str:
    """ "joint 1 angle, °": a curve's input with its unit."""
    title = input_title(curve.input, robot)
    bare = title == curve.input and curve.input_unit  # a sum of two joints' angles
    return f"{title}, {shown_unit(curve.input_unit)}" if bare else title


def curve_rows(calibration: Calibration) -> list[tuple[str, ...]]:
    """A row of `COLUMNS` for each learned curve in the model."""
    return [_row(curve) for curve in fitted_curves(calibration)]


def _row(curve: FittedCurve) -> tuple[str, ...]:
    place, value = curve.largest
    return (
        str(curve.joint + 1),
        curve.input,
        f"{curve.scale * curve.rms:.2g} {curve.unit}",
        f"{curve.scale * value:+.2g} {curve.unit}",
        f"{curve.input_scale * place:.3g} {shown_unit(curve.input_unit)}".strip(),
        f"{curve.known}/{curve.parameters}",
    )


def formulas(calibration: Calibration) -> list[str]:
    """The curves that are short formulas: their terms in words, and the formula with its values."""
    return [
        f"Joint {curve.joint + 1}: {curve.shape}; {curve.formula}."
        for curve in fitted_curves(calibration)
        if curve.formula
    ]


def curves_table_html(calibration: Calibration) -> str:
    """The learned curves of a fit as a table."""
    rows = curve_rows(calibration)
    return elements.table(COLUMNS, rows, left=2, asks=joint_asks(int(row[0]) for row in rows))


def learned_html(calibration: Calibration) -> str:
    """The learned curves of a fit: a table, the formulas where there are some, and what the figure below shows."""
    said = [*formulas(calibration), BAND_NOTE]
    table = elements.heading(f"Curves of {LEARNED}") + curves_table_html(calibration)
    return table + "".join(map(elements.note, said))


def offered_html(curves: LearnedCurves, calibration: Calibration) -> str:
    """The curves that can be added, and what they are worth."""
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
            else elements.wrapping(shape_text(member, calibration)),
        )
        for member in curves.members
    ]
    return (
        elements.heading(f"Effect {LEARNED}")
        + elements.facts(facts)
        + elements.table(
            ("joint", "over", "learned"),
            rows,
            left=3,
            asks=joint_asks(member.joint + 1 for member in curves.members),
        )
        + elements.note("No named effect explains what is left. The curves name no cause; add them to see them.")
    )
