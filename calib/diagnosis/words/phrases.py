"""Phrases that sentences are made of: a fault, poses, an input, what a parameter means on the arm."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from calib.array_types import BoolArray
from calib.calibration.result import Calibration
from calib.dataset.input_names import PLACES, joint_input
from calib.dataset.repeats import RepeatCount
from calib.diagnosis.words.sentences import DiscriminatingPose
from calib.effects.catalogue.loads import stiffness
from calib.effects.effect import Effect, Parameter, has_meaning, meaning_of
from calib.screening.candidates import Untestable
from calib.screening.smooth_motions import JointFault

_CONDITIONS = {
    "payload_kg": "the payload",
    "temperature_c": "the temperature",
    "time_s": "time",
    "order": "the order of measuring",
}


def capitalised(words: str) -> str:
    """The words with a capital letter first."""
    return words[:1].upper() + words[1:]


def listed(names: Sequence[str], last: str = "and") -> str:
    """ "a, b and c"."""
    return f"{', '.join(names[:-1])} {last} {names[-1]}" if len(names) > 1 else "".join(names)


def length_digits(length: float) -> str:
    """A length with the digits that a person reads: two significant ones, two decimals above one."""
    if not math.isfinite(length):
        return "–"
    size = abs(length)
    if size == 0.0 or size >= 99.95:
        return f"{length:.0f}"
    if size >= 0.995:
        return f"{length:.1f}" if size >= 9.995 else f"{length:.2f}"
    return f"{length:.{1 - math.floor(math.log10(float(f'{size:.1e}')))}f}"


def length_text(length_mm: float) -> str:
    """ "0.68 mm"; "12 µm" below a tenth of a millimetre."""
    if abs(length_mm) < 0.1:
        return f"{float(f'{1e3 * length_mm:.2g}'):g} \N{MICRO SIGN}m"
    return f"{length_digits(length_mm)} mm"


def times_text(ratio: float) -> str:
    """ "6.4 times", "120 times"."""
    return f"{float(f'{ratio:.2g}'):.7g} times"


def repeats_text(count: RepeatCount | None) -> str:
    """Sentence on points that are repeats of one pose; "" where there are none."""
    if count is None:
        return ""
    return (
        f" The dataset's {count.repeats} points form {count.groups} repeat groups of equal joints and conditions, and each "
        "group counts once, by the mean of its repeats."
    )


def curves_text(joints: Sequence[int], inputs: Sequence[str], log_evidence: float | None) -> str:
    """What curves of joints (counted from 1) over inputs are worth, a sentence."""
    worth = "" if log_evidence is None else f" (log evidence {log_evidence:.0f} over noise)"
    several = len(joints) > 1
    return (
        f"It follows {'curves' if several else 'a curve'} of joint{'s' if several else ''} "
        f"{listed([str(joint) for joint in joints])} over {listed(inputs)} that no effect of the catalogue "
        f"makes{worth}."
    )


def fault_text(fault: JointFault) -> str:
    """What a fault of one joint looks like, without a full stop."""
    return (
        f"joint {fault.joint + 1} moves the tool by about {fault.visible_mm:.2g} mm, beyond what links could, in a way "
        "that changes smoothly with the arm's attitude"
    )


def poses_text(poses: Sequence[DiscriminatingPose], is_revolute: BoolArray) -> str:
    """The poses as a person types them: degrees, or mm for prismatic joints (is_revolute  # (n,))."""
    lines = []
    for pose in poses:
        values = np.where(is_revolute, np.degrees(pose.q), pose.q)
        lines.append(f"({', '.join(f'{v:.0f}' for v in values)}): {pose.separation_mm:.2g} mm apart")
    return "; ".join(lines)


def input_text(name: str) -> str:
    """ "torque4" as one says it; a column of the user's own stays as it is."""
    of_joint = joint_input(name)
    if of_joint is not None:
        quantity, joint = of_joint
        return {
            "q": f"joint {joint + 1} (q{joint + 1})",
            "torque": f"gravity's torque on joint {joint + 1}",
            "approach": f"the approach of joint {joint + 1}",
        }[quantity]
    if name in PLACES:
        return f"{name} of the scanner's frame"
    return _CONDITIONS.get(name, name)


def untestable_line(family: Untestable) -> str:
    """One family in a line."""
    return f"not testable: {family.name}: {family.why}; {family.would_help}"


def untestable_texts(untestable: Sequence[Untestable]) -> list[str]:
    """A sentence for each reason why effects cannot be tested, with all the effects that it holds for."""
    names: dict[tuple[str, str], list[str]] = {}
    for family in untestable:
        names.setdefault((family.why, family.would_help), []).append(family.name)
    return [
        f"{listed(of)}: {why}. To test {'it' if len(of) == 1 else 'them'}: {would_help}."
        for (why, would_help), of in names.items()
    ]


def meaning(effect: Effect, parameter: Parameter, size: float, calibration: Calibration) -> str:
    """The consequence of a parameter in words, at this dataset's poses; "" where its value says it already.

    Args:
        effect: whose parameter it is.
        parameter: one of the effect's.
        size: in the parameter's unit.
        calibration: whose poses, torques and times it acts at.
    """
    if not np.isfinite(size) or size == 0.0:
        return ""
    if parameter.unit == "rad kg/Nm":  # a compliance times a mass that is not known
        return f"as 10 kg at that frame would make it with a {stiffness(0.1 * size)}"
    if has_meaning(effect):
        state = calibration.model.state(calibration.fit.x, calibration.dataset.poses)
        return meaning_of(effect, parameter, size, state)
    unit = parameter.unit
    if unit == "rad":
        return f"{np.degrees(size):.2g}\N{DEGREE SIGN}"
    if unit == "rad/Nm":
        return stiffness(size)
    if unit == "1/K":
        return f"{size * 1e6:.2g} \N{MICRO SIGN}m a metre and kelvin"
    if unit in ("mm/s", "rad/s"):
        return _over_the_run(size, unit, calibration)
    return f"{100.0 * size:.2g} %" if unit == "1" else ""


def _over_the_run(size: float, unit: str, calibration: Calibration) -> str:
    time_s = calibration.dataset.poses.time_s
    hours = float(np.ptp(time_s)) / 3600.0 if time_s is not None else 0.0
    if hours <= 0.0:
        return ""
    moved = size * 3600.0 * hours
    words = f"{moved:.2g} mm" if unit == "mm/s" else f"{np.degrees(moved):.2g}\N{DEGREE SIGN}"
    return f"{words} over the {hours:.2g} h measured"
