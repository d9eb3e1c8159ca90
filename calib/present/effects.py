"""Names of the catalogue's effects in sentences, meanings of their values on an arm, and untestable effects."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from calib.calibration.result import Calibration
from calib.diagnosis.effect_selection import SelectedEffect
from calib.effects.catalogue import descriptions
from calib.effects.catalogue.loads import stiffness
from calib.effects.effect import Effect, Parameter, has_meaning, meaning_of
from calib.present.results import keys_of
from calib.rendering import numbers
from calib.rendering.blocks import Span, effect, joint, listed, spans
from calib.screening.candidates import Untestable
from calib.screening.curves.smooth_joint_error import LEARNED


@cache
def _titles() -> dict[str, str]:
    return {described.name: described.title for described in descriptions()} | {LEARNED: "learned curves"}


def title(key: str) -> str:
    """Human-readable name of an effect: "joint compliance"; the key of a user's own effect."""
    return _titles().get(key, key)


def with_key(key: str) -> tuple[Span, ...]:
    """Human-readable name of an effect, and its key where that differs: "joint compliance (joint_compliance)"."""
    named = title(key)
    return (effect(key),) if named == key else spans(f"{named} (", effect(key), ")")


def meaning(owner: Effect, parameter: Parameter, size: float, calibration: Calibration) -> str:
    """Text on what a parameter's value means for the arm at a dataset's poses; "" where it would repeat the value.

    Args:
        owner: the effect whose parameter it is.
        parameter: one of the effect's.
        size: in the parameter's unit.
        calibration: the fit whose poses, torques and times it acts at.
    """
    if not np.isfinite(size) or size == 0.0:
        return ""
    if parameter.unit == "rad kg/Nm":  # a compliance times a mass that is not known
        of_10_kg = stiffness(0.1 * size)
        return of_10_kg if size < 0.0 else f"{of_10_kg} if 10 kg act at that frame"
    if has_meaning(owner):
        state = calibration.model.state(calibration.fit.x, calibration.dataset.poses)
        return meaning_of(owner, parameter, size, state)
    unit = parameter.unit
    if unit == "rad":
        return f"{np.degrees(size):.2g}°"
    if unit == "rad/Nm":
        return stiffness(size)
    if unit == "1/K":
        return f"{size * 1e6:.2g} µm per metre and kelvin"
    if unit in ("mm/s", "rad/s"):
        return _over_the_run(size, unit, calibration)
    return f"{100.0 * size:.2g} %" if unit == "1" else ""


def _over_the_run(size: float, unit: str, calibration: Calibration) -> str:
    time_s = calibration.dataset.poses.time_s
    hours = float(np.ptp(time_s)) / 3600.0 if time_s is not None else 0.0
    if hours <= 0.0:
        return ""
    moved = size * 3600.0 * hours
    words = f"{moved:.2g} mm" if unit == "mm/s" else f"{np.degrees(moved):.2g}°"
    return f"{words} over the {hours:.2g} h measured"


def not_testable(untestable: Sequence[Untestable]) -> list[str]:
    """Sentences with each reason why effects cannot be tested, and all effects to which the reason applies."""
    keys: dict[tuple[str, str], list[str]] = {}
    for family in untestable:
        keys.setdefault((family.why, family.would_help), []).append(family.name)
    return [
        f"{numbers.listing(of)}: {why}. To test {'it' if len(of) == 1 else 'them'}: {would_help}."
        for (why, would_help), of in keys.items()
    ]


def effects_document() -> dict[str, Any]:
    """Document that `effects --json` prints: the catalogue."""
    return {
        "effects": [
            {
                **keys_of(described, "name", "equation", "needs"),
                "parameters": [{"name": name, "unit": unit} for name, unit in described.symbols],
            }
            for described in descriptions()
        ]
    }


def with_joints(selected: SelectedEffect) -> tuple[Span, ...]:
    """An effect with the joints that carry it: "backlash (joints 1 and 3)"."""
    joints = sorted({index + 1 for m in selected.members if (index := getattr(m, "joint", None)) is not None})
    of = spans(f" (joint{'s' if len(joints) > 1 else ''} ", listed(map(joint, joints)), ")") if joints else ()
    return spans(selected.name, of)
