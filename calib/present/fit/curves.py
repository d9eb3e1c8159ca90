"""Presentation of learned curves of the joints: sizes, short formulas, and curves that could be added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from calib.calibration.result import Calibration
from calib.effects.effect import describe
from calib.kinematics.robot import Robot
from calib.present.fit.laws import law_sentences, sweep_document, sweep_words, wave_part
from calib.present.fit.residuals import input_title
from calib.rendering import numbers
from calib.rendering.blocks import Block, Bullets, Facts, Paragraph, Table, joint
from calib.screening.curves.fitted_curves import (
    FittedCurve,
    fitted_curves,
    learned_members,
    members_of_one_input,
    shape_text,
)
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.curves.law_readings import law_readings
from calib.screening.curves.readings import (
    BUMP,
    LOAD,
    OTHER_INPUT,
    ROUGH,
    SLOPE,
    TWO_JOINTS,
    WAVE,
    WAVES,
    CouplingReading,
    CurveReading,
    coupling_readings,
    curve_readings,
)
from calib.screening.curves.smooth_joint_error import LEARNED, inputs_named, is_law

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
    if curve.factor:
        title = f"{title}; at {curve.factor} {curve.factor_size:.3g}"
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
    laws = iter(law_sentences(law_readings(calibration)))
    readings = curve_readings(calibration)
    of_one_input = members_of_one_input(calibration)
    of_curves = [one for one, member in zip(readings, of_one_input, strict=True) if not is_law(member)]
    shapes = [
        next(laws) if is_law(member) else f"{numbers.capitalised(reading_phrase(one))}{part_words(one)}."
        for one, member in zip(readings, of_one_input, strict=True)
    ]
    shapes += coupling_sentences(coupling_readings(calibration))
    equation = Paragraph(f"{LEARNED}: {members[0].equation}. It names no cause.")
    return [
        equation,
        curve_table(calibration),
        Paragraph(_KNOWN_NOTE, soft=True),
        *map(Paragraph, formulas(calibration)),
        Bullets(shapes),
        Paragraph(sweep_sentence(of_curves)),
    ]


# ---- what a curve looks like ----------------------------------------------------------------------------------------


def reading_phrase(one: CurveReading) -> str:
    """Phrase on what a learned curve looks like: "joint 3 has a wave of 9 a turn (71 % of its square)"."""
    waves = numbers.listing([str(n) for n in one.waves_per_turn])
    shape = {
        SLOPE: "a slope",
        WAVE: f"a wave of {waves} a turn",
        WAVES: f"waves of {waves} a turn",
        BUMP: "a bump" + ("" if one.place_deg is None else f" at {numbers.signed(one.place_deg, '.0f')}°"),
        LOAD: f"a ripple that follows the load ({one.input})",
        TWO_JOINTS: f"a curve over two joints together ({one.input})",
        OTHER_INPUT: f"a curve over {one.input}",
        ROUGH: f"a rough curve, its strongest waves {waves} a turn",
    }[one.kind]
    share = "" if one.kind in (LOAD, TWO_JOINTS, OTHER_INPUT) else f" ({numbers.share(one.share)} of its square)"
    return f"joint {one.joint} has {shape}{share}"


def part_words(one: CurveReading) -> str:
    """Clause on the parts of a joint that make such a curve, with a comma before it; "" where nothing is known."""
    if one.kind in (WAVE, WAVES):
        if one.per_motor_turn is not None:
            often = {1: "once", 2: "twice"}[one.per_motor_turn]
            part = "the motor's side, or the wave generator of a strain wave gear"
            return f", {often} a turn of the motor, as {part} makes it"
        return f", as {wave_part(one.waves_per_turn[0])}"
    return {
        SLOPE: ", as a scale error of encoder or gear makes it, or a slow wave of which the range shows a part",
        BUMP: ", as a damaged tooth or a dent in a bearing's ring makes it",
        LOAD: ", as gear teeth and bearings make it that give way unevenly",
        TWO_JOINTS: ", as a cable or hose makes it that both joints move, or a coupling of their gears",
        ROUGH: ", as teeth, bearing and encoder together make it",
    }.get(one.kind, "")


def sweep_sentence(readings: Sequence[CurveReading]) -> str:
    """Sentence on the motions of single joints that show each curve by itself; "" where there are none."""
    moves = "; ".join(sweep_words(one.sweep) for one in readings if one.sweep is not None)
    return f"To see each by itself, move one joint alone, all others at rest: {moves}." if moves else ""


def coupling_sentences(readings: Sequence[CouplingReading]) -> list[str]:
    """Sentences on joints that err as the whole arm stands."""
    return [
        f"Joint {one.joint} errs by {1e3 * one.size:.2g} mrad RMS as all joints together stand, most by "
        f"{numbers.listing(one.strongest)} ({one.known} of {one.parameters} modes known), as cables that run through "
        "the arm make it, or weights that robot.toml lacks."
        for one in readings
    ]


def readings_document(readings: Sequence[CurveReading]) -> list[dict[str, Any]]:
    """JSON of the readings of learned curves, each with its sentence and the sweep that shows it by itself."""
    return [
        {
            **asdict(one),
            "words": f"{reading_phrase(one)}{part_words(one)}",
            "sweep": sweep_document(one.sweep),
        }
        for one in readings
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
        f"{curve.factor} x {curve.input}" if curve.factor else curve.input,
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
            inputs_named(member.modes),
            f"a curve of {len(member.parameters)} modes" if not is_law(member) else shape_text(member, calibration),
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
