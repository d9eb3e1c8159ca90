"""Presentation of learned curves and laws of joints: form, size, the part that makes it, what would refute it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from calib.calibration.result import Calibration
from calib.dataset.input_names import joint_input
from calib.effects.effect import describe
from calib.kinematics.robot import Robot
from calib.present.names import input_name, input_title, read_unit
from calib.rendering import numbers
from calib.rendering.blocks import Block, Bullets, Facts, FigurePlace, Paragraph, Section, Table, joint, plain
from calib.screening.curves import laws
from calib.screening.curves.fitted_curves import (
    FittedCurve,
    fitted_curves,
    learned_members,
    members_of_one_input,
    shape_text,
)
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.curves.law_readings import LawReading, law_readings
from calib.screening.curves.law_search import FoundLaws
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
    Sweep,
    coupling_readings,
    curve_readings,
)
from calib.screening.curves.smooth_joint_error import LEARNED, inputs_named, is_law

_COLUMNS = ("joint", "over", "rms", "largest", "at", "known")
BAND_NOTE = (
    "Each joint's learned error over its input. Band: two sigmas by the fit's covariance, the prior in it; grey: not "
    "measured. What geometry can do too is shared between the two, so only the shape beyond that is sure."
)
_KNOWN_NOTE = "Known: how many of a curve's modes these data determine by themselves."
_FEW_WAVES = 20  # a turn, from rollers of a bearing to teeth of a gear
_PARTS = {
    laws.LOAD: "a spring or gear that is stiffer on one part of its load than on the other makes it",
    laws.LOAD_BY_ANGLE: "gear teeth, rollers or a housing that give way unevenly under load make it",
    laws.LOAD_OF_ANOTHER: "a tendon, belt or shaft of that joint which is led past this one makes it",
    laws.COUPLING: "a belt, shaft or tendon of that joint which runs through this one makes it",
    laws.COUPLING_WAVE: "a wheel or gear of that joint's transmission out of true makes it, led through this one",
    laws.TWO_JOINTS: "a cable or hose that both joints move makes it, or a wheel that turns with both",
    laws.PRODUCT: "a cable or tendon makes it that one joint tightens the more the further the other has turned",
    laws.WAY: "a drive that was read before it settled makes it, or a hose that lies as the pose before left it",
    laws.DIRECTION: "play or friction makes it",
    laws.DIRECTION_BY_ANGLE: "play or friction makes it that changes along the ring, as where teeth are worn",
    laws.DIRECTION_BY_LOAD: "friction in proportion to the load makes it",
    laws.MEMORY: "rubber, plastic or a hose that recovers slowly makes it, or a drive that creeps under load",
    laws.WEAR: "a clamp or belt that works loose with every motion makes it",
    laws.TIME: "heat or slow settling makes it",
}
_TERMS = {
    "line": "a slope",
    "kink": "a kink",
    "hinge": "a slope that begins",
    "step": "a step",
    "bump": "a bump",
    "root": "a root of the distance",
    "square": "a part that grows with the square",
}


# ---- curves ---------------------------------------------------------------------------------------------------------


def learned_section(calibration: Calibration) -> list[Section]:
    """The learned curves in a model: their sizes, formulas and figure; [] where there are none."""
    if not learned_members(calibration):
        return []
    figure = FigurePlace("learned_curves", (calibration,), BAND_NOTE, height_px=0)
    drawn = [figure] if members_of_one_input(calibration) else []
    return [Section("Learned curves of the joints", [*curve_blocks(calibration), *drawn])]


def input_label(curve: FittedCurve, robot: Robot) -> str:
    """A curve's input with its unit: "joint 1 (q1), °"."""
    at = f"; at {curve.factor} {curve.factor_size:.3g}" if curve.factor else ""
    return f"{input_title(curve.input, robot)}{at}"


def curve_blocks(calibration: Calibration) -> list[Block]:
    """Blocks on the learned curves of a model: explanation, table, and short formulas; [] without learned curves."""
    members = learned_members(calibration)
    if not members:
        return []
    told_laws = iter(law_sentences(law_readings(calibration)))
    readings = curve_readings(calibration)
    of_one_input = members_of_one_input(calibration)
    of_curves = [one for one, member in zip(readings, of_one_input, strict=True) if not is_law(member)]
    shapes = [
        next(told_laws) if is_law(member) else f"{numbers.capitalised(reading_phrase(one))}{part_words(one)}."
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
    return [{**asdict(one), "words": f"{reading_phrase(one)}{part_words(one)}"} for one in readings]


def curve_table(calibration: Calibration) -> Table:
    """Table with a row for each learned curve of a model."""
    curves = fitted_curves(calibration)
    return Table(_COLUMNS, [_row(c) for c in curves], left=(0, 1), rows_select=[joint(c.joint + 1) for c in curves])


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


# ---- laws -----------------------------------------------------------------------------------------------------------


def law_sentences(readings: Sequence[LawReading], found: FoundLaws | None = None) -> list[str]:
    """Sentences on each law: form, size, part and refutation; and the laws that say about as much, where known."""
    return [law_sentence(one) + _rivals(one, found) for one in readings]


def law_sentence(one: LawReading) -> str:
    """Sentences on one law: "Joint 3 errs by a wave of 9 a turn of joint 2's angle: 0.21 ± 0.02 mrad ..."."""
    return f"{law_phrase(one)}: {size_words(one)}; {part_of_law(one)}. {refutation_sentence(one)}"


def law_phrase(one: LawReading, *, begin: str = "Joint") -> str:
    """Clause on the form of a law: "Joint 3 errs by a wave of 9 a turn of the angle of joint 2"."""
    return f"{begin} {one.joint} errs by {_shape(one)}{_over(one)}{_times(one)}"


def size_words(one: LawReading) -> str:
    """Clause on the size of a law: with sigma, 95 % bounds, the value of the input it is told at, and at the tool."""
    scale, unit = (1e3, "mrad") if one.is_revolute else (1.0, "mm")
    told = numbers.with_sigma(scale * one.size, scale * one.sigma, unit)
    low, high = (numbers.signed(scale * value, ".3g") for value in (one.low, one.high))
    rms = " RMS" if len(one.terms) > 1 else ""
    return f"{told}{rms}{_at(one)} (95 %: {low} to {high} {unit}), {numbers.length(one.tool_mm)} RMS at the tool"


def part_of_law(one: LawReading) -> str:
    """Clause on the part that typically makes a law."""
    if one.kind != laws.ANGLE:
        return _PARTS[one.kind]
    if one.waves_per_turn:
        return wave_part(one.waves_per_turn[0])
    if "bump" in one.terms:
        return "a damaged tooth or a dent in a bearing's ring makes it"
    return "an encoder's scale or a gear that changes along the way makes it"


def refutation_sentence(one: LawReading) -> str:
    """Sentences on the motions that would refute a law, with the change that it forecasts."""
    test, scale, unit = one.refuted_by, *((1e3, "mrad") if one.is_revolute else (1.0, "mm"))
    forecast = f"{abs(scale * test.forecast):.2g} {unit} ({numbers.length(test.forecast_mm)} at the tool)"
    where = f"pose {test.at_poses[0]}, then at pose {test.at_poses[1]}" if len(test.at_poses) > 1 else ""
    if test.sweep is not None:
        motion = f"move {sweep_words(test.sweep, ' alone')}"
        if one.kind in (laws.DIRECTION, laws.DIRECTION_BY_ANGLE):
            says = f"from both sides: by the law the two ways differ by up to {forecast}"
        elif where:
            says = f"all others as at {where}: by the law the error of joint {one.joint} differs by {forecast}"
        else:
            says = f"all others at rest: by the law the error of joint {one.joint} changes by {forecast} meanwhile"
        held = "difference" if "-" in one.input else "sum"
        together = f"; with both moved so that the {held} stays, nothing changes" if one.kind == laws.TWO_JOINTS else ""
        return f"To refute it, {motion}, {says}{together}; less than half of it refutes the law."
    again = f"measure {where} again" if where else "measure one pose again"
    if one.kind == laws.MEMORY:
        again = "go a long way to one pose and measure it at once and again and again while the arm rests"
    elif one.kind in (laws.WAY, laws.DIRECTION, laws.DIRECTION_BY_LOAD):
        again = "measure one pose again and again, coming to it from both sides and after short and long ways"
    elif one.kind == laws.WEAR:
        again = "measure one pose at the beginning, in the middle and at the end of a long session"
    says = f"by the law the error differs by up to {forecast}; less than half of it refutes the law."
    return f"To refute it, {again}: {says}"


def laws_document(readings: Sequence[LawReading], found: FoundLaws | None = None) -> list[dict[str, Any]]:
    """JSON of laws: form, numbers, sentences, the motion that would refute each, and how many forms were tried."""
    tried = None if found is None else found.tried
    told = law_sentences(readings, found)
    return [{**asdict(one), "words": words, "tried": tried} for one, words in zip(readings, told, strict=True)]


def sweep_words(sweep: Sweep, alone: str = "") -> str:
    """Phrase on a motion of one joint: "joint 3 from −90° to 90° in steps of 5° (37 poses)"."""
    start, end = (numbers.signed(value, ".0f") for value in (sweep.start_deg, sweep.end_deg))
    return f"joint {sweep.joint}{alone} from {start}° to {end}° in steps of {sweep.step_deg:g}° ({sweep.poses} poses)"


def wave_part(order: int) -> str:
    """Clause on the part of a joint that makes a wave of so many periods a turn."""
    if order <= 2:
        return "an encoder's disc, an output gear or a bearing's ring that is eccentric (1) or oval (2) makes it"
    if order <= _FEW_WAVES:
        return "the rollers of the output bearing, or an encoder's interpolation, make it"
    return "the teeth of a gear ring, the gear's ratio or twice that (the motor's side), or an encoder's lines make it"


def _shape(one: LawReading) -> str:
    if one.waves_per_turn:
        waves = numbers.listing([str(n) for n in one.waves_per_turn])
        return f"{'a wave' if len(one.waves_per_turn) == 1 else 'waves'} of {waves} a turn"
    terms = list(dict.fromkeys(_TERMS[kind] for kind in one.terms if kind != "harmonic"))
    if terms == ["a slope"] and not one.factor:
        return "a share"
    at = "" if one.place is None or len(one.terms) > 1 else f" at {_place(one)}"
    return f"{numbers.listing(terms)}{at}"


def _place(one: LawReading) -> str:
    assert one.place is not None
    if one.kind == laws.ANGLE and one.is_revolute:
        return f"{numbers.signed(float(np.degrees(one.place)), '.0f')}°"
    unit = {laws.ANGLE: " mm", laws.LOAD: " Nm"}.get(one.kind, "")
    return f"{numbers.signed(one.place, '.3g')}{unit}"


def _over(one: LawReading) -> str:
    """The input that a law runs over, as a clause behind its shape."""
    if one.kind == laws.TWO_JOINTS:
        combined = "difference" if "-" in one.input else "sum"
        pair = numbers.listing(sorted({one.joint, *one.other_joints}))
        return f" over the {combined} of the angles of joints {pair}"
    quantity, index = joint_input(one.input) or ("", -1)
    if index + 1 == one.joint and quantity in ("q", "torque"):
        own = "angle" if one.is_revolute else "position"
        return " over gravity's torque on it" if quantity == "torque" else f" over its own {own}"
    return f" over {f'the angle of joint {index + 1}' if quantity == 'q' else plain((input_name(one.input),))}"


def _times(one: LawReading) -> str:
    """The factor of a law, as a clause behind its input."""
    if one.kind == laws.LOAD_BY_ANGLE:
        return ", in proportion to gravity's torque on it"
    if one.kind in (laws.DIRECTION_BY_ANGLE, laws.DIRECTION_BY_LOAD):
        return ", of the other sign when it comes from the other side"
    if one.kind == laws.PRODUCT:
        return f", in proportion to the angle of joint {one.factor.removeprefix('q')}"
    return ""


def _at(one: LawReading) -> str:
    """At which values of its inputs a law has its size: " at 33 Nm"."""
    if not one.at:
        return ""
    values = [f"{np.degrees(of.value):.3g}°" if of.unit == "deg" else f"{of.value:.3g} {of.unit}" for of in one.at]
    if len(values) > 1:
        values = [f"{value} of {of.input}" for value, of in zip(values, one.at, strict=True)]
    return f" at {numbers.listing(values)}"


def _rivals(one: LawReading, found: FoundLaws | None) -> str:
    """Sentence on other laws that say about as much as one of those that were found; "" where there are none."""
    laws_found = () if found is None else found.laws
    alike = [
        form
        for law in laws_found
        if (law.member.joint + 1, law.member.modes.input) == (one.joint, one.input)
        for form in law.rivals
    ]
    named = [f"{form.kind} of joint {form.joint + 1} ({_inputs(form)})" for form in alike[:3]]
    return f" As likely: {numbers.listing(named, 'or')}." if named else ""


def _inputs(form: laws.LawForm) -> str:
    return f"{form.modes.factor} x {form.modes.input}" if form.modes.factor else form.modes.input
