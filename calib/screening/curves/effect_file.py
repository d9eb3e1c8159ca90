"""Learned curves as a Python file of the user's own: to be read, edited, and loaded with --effects-file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pprint import pformat

import numpy as np

from calib.calibration.result import Calibration
from calib.effects.effect import full_name
from calib.errors import CalibError
from calib.screening.curves.smooth_joint_error import CurveModes, FormulaModes, SmoothJointError

_HEAD = '''"""{title}

theta_j += share * f_j(u): the curves below were learned from measurements, share = 1 is the curve as it was learned.
Angles are rad, u is the input's value in rad (mm, Nm, C or s as the input is). Edit what you like; then

    inspector calibrate DATASET --effects-file {file} --effect learned_joint_error
    inspector correct DATASET --effects-file {file} --effect learned_joint_error --joints IN.csv --out OUT.csv
"""

from dataclasses import dataclass

import numpy as np

from calib import Parameter
from calib.screening.curves.smooth_joint_error import input_values

'''

_TAIL = '''

@dataclass(frozen=True)
class LearnedJointError:
    """The curves of one joint, added up."""

    joint: int  # filled in for each joint, from 0
    parameters = (Parameter("share", unit="1", scale=1.0, doc="of the learned curve; 1 is all of it"),)
    linear = True

    def apply(self, state, *, share):
        error = 0.0
        for curve in CURVES.get(self.joint + 1, ()):
            u = np.clip(input_values(state, curve["input"]), curve["low"], curve["high"])
            error = error + share * curve_at(curve, u)
        return state.add_joint_error(self.joint, error)


def curve_at(curve, u):
    """(N,) rad, at inputs (N,)."""
    phase = curve["rate"] * (u - curve["start"])
    out = np.zeros(len(u))
    for n, sine, cosine in curve["harmonics"]:
        out += sine * np.sin(n * phase) + cosine * np.cos(n * phase)
    for kind, place, width, height in curve["terms"]:
        off = u - place
        if kind == "bump":
            out += height * np.exp(-0.5 * (off / width) ** 2)
        elif kind == "kink":
            out += height * np.abs(off)
        elif kind == "step":
            out += height * (off > 0.0)
        elif kind == "square":
            out += height * u * np.abs(u)
    return out
'''


def effect_file_text(calibration: Calibration, file: str) -> str:
    """The text of a file with the learned curves of a fit.

    Args:
        calibration: a fit with learned curves in its model.
        file: the file's name, for the commands that its docstring shows.

    Raises CalibError where the model has none.
    """
    members = [effect for effect in calibration.model.effects if isinstance(effect, SmoothJointError)]
    if not members:
        raise CalibError(f"{file}: not written; no curves were learned, so there is nothing to write")
    fit, dataset = calibration.fit, calibration.dataset
    values = dict(zip((p.name for p in fit.parameters), fit.x.tolist(), strict=True))
    title = f"Curves of the joints of {dataset.robot.name}, learned from the dataset {dataset.name}."
    curves: dict[int, list[dict[str, object]]] = {}
    for member in members:
        fitted = np.array([values[full_name(member, p)] for p in member.parameters])
        curves.setdefault(member.joint + 1, []).append(_curve(member, fitted))
    one_line = " ".join(title.replace('"""', "'''").replace("\\", "/").split())
    text = _HEAD.format(title=one_line, file=file)
    return f"{text}CURVES = {pformat(curves, width=110, sort_dicts=False)}\n{_TAIL}"


def _curve(member: SmoothJointError, fitted: np.ndarray) -> dict[str, object]:
    modes = member.modes
    out: dict[str, object] = {"input": modes.input, "low": -1e300, "high": 1e300, "start": 0.0, "rate": 1.0}
    harmonics: list[tuple[float, float, float]] = []
    terms: list[tuple[str, float, float, float]] = []
    if isinstance(modes, CurveModes):
        out |= {
            "low": max(modes.low, -1e300),
            "high": min(modes.high, 1e300),
            "start": modes.start,
            "rate": modes.rate,
        }
        pairs = (modes.weights @ fitted).reshape(-1, 2)
        harmonics = [(int(n), float(s), float(c)) for n, (s, c) in zip(modes.orders, pairs, strict=True)]
    else:
        at = 0
        for term in modes.terms:
            own = fitted[at : at + len(term.names)]
            at += len(own)
            if term.kind == "harmonic":
                harmonics.append((term.order, float(own[0]), float(own[1])))
            else:
                terms.append((term.kind, term.place, term.width, float(own[0])))
    return out | {"harmonics": harmonics, "terms": terms}


def formula_text(members: Sequence[SmoothJointError], values: Mapping[str, float]) -> str | None:
    """The members' formulas with their fitted values, or None where one of them is a curve without a formula."""
    lines = []
    for member in members:
        if not isinstance(member.modes, FormulaModes):
            return None
        lines.append(_formula_of(member, member.modes, values))
    return "; ".join(lines)


def _formula_of(member: SmoothJointError, modes: FormulaModes, values: Mapping[str, float]) -> str:
    fitted = iter(values[full_name(member, p)] for p in member.parameters)
    u = modes.input
    parts = []
    for term in modes.terms:
        if term.kind == "harmonic":
            parts += [
                f"{next(fitted):+.3g} sin({term.order} {u})",
                f"{next(fitted):+.3g} cos({term.order} {u})",
            ]
            continue
        shape = {
            "bump": f"exp(-(({u} - {term.place:.3g}) / {term.width:.3g})^2 / 2)",
            "kink": f"abs({u} - {term.place:.3g})",
            "step": f"({u} > {term.place:.3g})",
            "square": f"{u} abs({u})",
        }[term.kind]
        parts.append(f"{next(fitted):+.3g} {shape}")
    return f"theta{member.joint + 1} += {' '.join(parts).removeprefix('+')} rad"
