"""Presentation of laws of joints: form, size with sigma and bounds, the part that makes it, what would refute it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from calib.rendering import numbers
from calib.screening.curves.law_readings import LawReading
from calib.screening.curves.law_search import FoundLaws
from calib.screening.curves.laws import (
    ANGLE,
    COUPLING,
    COUPLING_WAVE,
    DIRECTION,
    DIRECTION_BY_ANGLE,
    DIRECTION_BY_LOAD,
    LOAD,
    LOAD_BY_ANGLE,
    LOAD_OF_ANOTHER,
    MEMORY,
    PRODUCT,
    TIME,
    TWO_JOINTS,
    WAY,
    WEAR,
    LawForm,
)
from calib.screening.curves.readings import Sweep

_FEW_WAVES = 20  # a turn, from rollers of a bearing to teeth of a gear
_PARTS = {
    LOAD: "a spring or gear that is stiffer on one part of its load than on the other makes it",
    LOAD_BY_ANGLE: "gear teeth, rollers or a housing that give way unevenly under load make it",
    LOAD_OF_ANOTHER: "a tendon, belt or shaft of that joint which is led past this one makes it",
    COUPLING: "a belt, shaft or tendon of that joint which runs through this one makes it",
    COUPLING_WAVE: "a wheel or gear of that joint's transmission which is out of true makes it, led through this one",
    TWO_JOINTS: "a cable or hose that both joints move makes it, or a wheel that turns with both",
    PRODUCT: "a cable or tendon makes it that one joint tightens the more the further the other has turned",
    WAY: "a drive that was read before it settled makes it, or a hose that lies as the pose before left it",
    DIRECTION: "play or friction makes it",
    DIRECTION_BY_ANGLE: "play or friction makes it that changes along the ring, as where teeth are worn",
    DIRECTION_BY_LOAD: "friction in proportion to the load makes it",
    MEMORY: "rubber, plastic or a hose that recovers slowly makes it, or a drive that creeps under load",
    WEAR: "a clamp or belt that works loose with every motion makes it",
    TIME: "heat or slow settling makes it",
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
    if one.kind != ANGLE:
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
        if one.kind in (DIRECTION, DIRECTION_BY_ANGLE):
            says = f"from both sides: by the law the two ways differ by up to {forecast}"
        elif where:
            says = f"all others as at {where}: by the law the error of joint {one.joint} differs by {forecast}"
        else:
            says = f"all others at rest: by the law the error of joint {one.joint} changes by {forecast} meanwhile"
        held = "difference" if "-" in one.input else "sum"
        together = f"; with both moved so that the {held} stays, nothing changes" if one.kind == TWO_JOINTS else ""
        return f"To refute it, {motion}, {says}{together}; less than half of it refutes the law."
    again = f"measure {where} again" if where else "measure one pose again"
    if one.kind == MEMORY:
        again = "go a long way to one pose and measure it at once and again and again while the arm rests"
    elif one.kind in (WAY, DIRECTION, DIRECTION_BY_LOAD):
        again = "measure one pose again and again, coming to it from both sides and after short and long ways"
    elif one.kind == WEAR:
        again = "measure one pose at the beginning, in the middle and at the end of a long session"
    says = f"by the law the error differs by up to {forecast}; less than half of it refutes the law."
    return f"To refute it, {again}: {says}"


def laws_document(readings: Sequence[LawReading], found: FoundLaws | None = None) -> list[dict[str, Any]]:
    """JSON of laws: form, numbers, sentence, what would refute each, and the laws that say about as much."""
    tried = None if found is None else found.tried
    return [
        {
            **asdict(one),
            "unit": "rad" if one.is_revolute else "mm",
            "part": part_of_law(one),
            "words": law_sentence(one),
            "refuted_by": {
                **asdict(one.refuted_by),
                "sweep": sweep_document(one.refuted_by.sweep),
                "words": refutation_sentence(one),
            },
            "tried": tried,
            "as_likely": [
                {"joint": other.joint + 1, "kind": other.kind, "input": other.modes.input, "factor": other.modes.factor}
                for other in _others(one, found)
            ],
        }
        for one in readings
    ]


def sweep_words(sweep: Sweep, alone: str = "") -> str:
    """Phrase on a motion of one joint: "joint 3 from −90° to 90° in steps of 5° (37 poses)"."""
    start, end = (numbers.signed(value, ".0f") for value in (sweep.start_deg, sweep.end_deg))
    return f"joint {sweep.joint}{alone} from {start}° to {end}° in steps of {sweep.step_deg:g}° ({sweep.poses} poses)"


def sweep_document(sweep: Sweep | None) -> dict[str, Any] | None:
    """JSON value of a motion of one joint."""
    return None if sweep is None else {**asdict(sweep), "poses": sweep.poses}


def wave_part(order: int) -> str:
    """Clause on the part of a joint that makes a wave of so many periods a turn."""
    if order <= 2:
        return "an encoder's disc, an output gear or a bearing's ring that is eccentric (1) or oval (2) makes it"
    if order <= _FEW_WAVES:
        return "the rollers of the output bearing, or an encoder's interpolation, make it"
    return "the teeth of a gear ring, the gear's ratio or twice that (the motor's side), or an encoder's lines make it"


# ---- parts of a sentence --------------------------------------------------------------------------------------------


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
    if one.kind == ANGLE and one.is_revolute:
        return f"{numbers.signed(float(np.degrees(one.place)), '.0f')}°"
    unit = {ANGLE: " mm", LOAD: " Nm"}.get(one.kind, "")
    return f"{numbers.signed(one.place, '.3g')}{unit}"


def _over(one: LawReading) -> str:
    """The input that a law runs over, as " of ..." behind its shape."""
    j = one.joint
    other = one.other_joints[0] if one.other_joints else j
    signed = "difference" if "-" in one.input else "sum"
    reach = one.input.rpartition("_")[2].replace("poses", " poses")
    reach = f"{reach[:-1]} s" if reach.endswith("s") and not reach.endswith("poses") else reach
    pair = numbers.listing(sorted({j, *one.other_joints}))
    return {
        ANGLE: " over its own angle" if one.is_revolute else " over its own position",
        LOAD: " over gravity's torque on it",
        LOAD_BY_ANGLE: " over its own angle",
        LOAD_OF_ANOTHER: f" of gravity's torque on joint {other}",
        COUPLING: f" of the angle of joint {other}",
        COUPLING_WAVE: f" of the angle of joint {other}",
        TWO_JOINTS: f" of the {signed} of the angles of joints {pair}",
        PRODUCT: f" over the angle of joint {one.input.removeprefix('q')}",
        WAY: f" of the way of joint {other} from the pose before",
        DIRECTION: f" of the direction in which joint {other} came",
        DIRECTION_BY_ANGLE: " over its own angle",
        DIRECTION_BY_LOAD: " over gravity's torque on it",
        WEAR: f" of all the way that joint {other} has gone",
        TIME: " over time" if one.input == "time_s" else " over the temperature",
        MEMORY: f" of the load of its last {reach}"
        if one.input.startswith("crept")
        else f" of the way from where it was in the last {reach}",
    }[one.kind]


def _times(one: LawReading) -> str:
    """The factor of a law, as a clause behind its input."""
    if one.kind == LOAD_BY_ANGLE:
        return ", in proportion to gravity's torque on it"
    if one.kind in (DIRECTION_BY_ANGLE, DIRECTION_BY_LOAD):
        return ", of the other sign when it comes from the other side"
    if one.kind == PRODUCT:
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


def _others(one: LawReading, found: FoundLaws | None) -> tuple[LawForm, ...]:
    """Other laws that say about as much as one of those that were found."""
    if found is None:
        return ()
    same = [law for law in found.laws if law.member.joint + 1 == one.joint and law.member.modes.input == one.input]
    return same[0].rivals if same else ()


def _rivals(one: LawReading, found: FoundLaws | None) -> str:
    others = _others(one, found)
    if not others:
        return ""
    named = [f"{other.kind} of joint {other.joint + 1} ({_inputs(other)})" for other in others[:3]]
    return f" As likely: {numbers.listing(named, 'or')}."


def _inputs(form: LawForm) -> str:
    return f"{form.modes.factor} x {form.modes.input}" if form.modes.factor else form.modes.input
