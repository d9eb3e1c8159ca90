"""Facts on the effects that a diagnosis found: the joints concerned, the size, and the pose with the largest change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.effects.effect import (
    Effect,
    NaturalBound,
    Parameter,
    exceeded_bound,
    family_name,
    full_name,
    parameters_by_name,
)
from calib.fitting.observations import Observations, predict_points
from calib.screening.candidates import Candidate
from calib.statistics import rms_length

_SIGNIFICANT = 2.0  # sigmas from which a value is known to differ from zero


# ---- members of an effect -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MainValue:
    """Value that sums up a fitted effect on one joint: the amplitude of several angles, or its surest parameter."""

    parameter: Parameter | None  # None: an amplitude
    name: str  # full, with the unit at its end
    value: float
    sigma: float
    unit: str


def main_value(member: Effect, calibration: Calibration) -> MainValue | None:
    """Main value of an effect on one joint as fitted; None where none of its parameters was fitted."""
    fitted = calibration.fit.by_name
    known = [p for p in member.parameters if full_name(member, p) in fitted]
    if not known:
        return None
    values = [fitted[full_name(member, parameter)] for parameter in known]
    if len(known) > 1 and all(parameter.unit == "rad" for parameter in known):
        amplitude = float(np.sqrt(sum(value**2 for value, _ in values)))
        sigma = float(np.sqrt(sum((value * s) ** 2 for value, s in values))) / max(amplitude, 1e-300)
        prefix = full_name(member, known[0]).rpartition(".")[0]
        return MainValue(None, f"{prefix}.amplitude_rad", amplitude, sigma, "rad")
    surest = int(np.argmax([abs(value) / max(sigma, 1e-300) for value, sigma in values]))
    return MainValue(known[surest], full_name(member, known[surest]), *values[surest], known[surest].unit)


def moved_mm(members: Sequence[Effect], calibration: Calibration) -> list[float]:
    """RMS shift, mm, of the measured points by each of some effects alone, less the shift's mean."""
    model, x = calibration.model, calibration.fit.x
    names = [parameter.name for parameter in model.parameters]
    observed = Observations.of(calibration.fitted_dataset)
    with_all = predict_points(model, x, observed)

    def rms_mm(member: Effect) -> float:
        own = {full_name(member, parameter) for parameter in member.parameters}
        without = np.where([name in own for name in names], 0.0, x)
        shift: Array = with_all - predict_points(model, without, observed)
        return rms_length(shift - shift.mean(axis=0))

    return list(map(rms_mm, members))


# ---- an effect in the model -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class AtPose:
    """A length, mm, at one pose."""

    pose: str  # id
    size_mm: float


@dataclass(frozen=True)
class Cause:
    """An effect that was added to a model: the joints that carry it, its size, and the pose where it changes most."""

    effect: str
    joints: tuple[int, ...]  # of significant value, counted from 1, the one that moves the tool the most first
    leading: Effect | None  # the member that moves the tool the most; None where the model has none
    main: MainValue | None  # of that member
    largest: AtPose | None  # where the predicted point changes the most


def cause_of(effect: str, before: Calibration, after: Calibration) -> Cause:
    """Joints, size and largest change of an effect, from a fit without it and a fit with it to the same points.

    Joints are listed by their own values: one within two sigmas of zero is left out, unless it is the leading one.
    """
    members = [member for member in after.model.effects if family_name(member) == effect]
    moved = moved_mm(members, after) if len(members) > 1 else [0.0] * len(members)
    ranked = [members[k] for k in sorted(range(len(members)), key=lambda k: -moved[k])]
    mains = [main_value(member, after) for member in ranked]
    significant = [m for m, main in zip(ranked, mains, strict=True) if main is not None and _is_significant(main)]
    carriers = significant or ranked[:1]
    joints = dict.fromkeys(joint + 1 for m in carriers if (joint := getattr(m, "joint", None)) is not None)
    leading = next(iter(carriers), None)
    main = None if leading is None else mains[ranked.index(leading)]
    return Cause(effect, tuple(joints), leading, main, _largest_change(before, after))


def _is_significant(main: MainValue) -> bool:
    return abs(main.value) > _SIGNIFICANT * main.sigma


def worst_pose(calibration: Calibration, poses: tuple[str, ...] = ()) -> AtPose | None:
    """Pose with the largest 3D error after a fit, among some poses or all."""
    after, ids = calibration.after, calibration.dataset.poses.ids
    error_mm = np.linalg.norm(after.error_mm, axis=1)
    if poses:
        error_mm = np.where(np.isin(np.array(ids)[after.pose], poses), error_mm, -1.0)
    if error_mm.max(initial=-1.0) < 0.0:
        return None
    worst = int(np.argmax(error_mm))
    return AtPose(ids[after.pose[worst]], float(error_mm[worst]))


def _largest_change(before: Calibration, after: Calibration) -> AtPose | None:
    """Pose with the largest displacement of a predicted point from one fit to another, in the scanner's frame."""
    if not np.array_equal(before.after.pose, after.after.pose) or not len(after.after.pose):
        return None
    change_mm = np.linalg.norm(after.after.error_mm - before.after.error_mm, axis=1)
    most = int(np.argmax(change_mm))
    return AtPose(after.dataset.poses.ids[after.after.pose[most]], float(change_mm[most]))


def visible_mm(candidate: Candidate, before: Calibration) -> float | None:
    """RMS, mm, over the training poses, of the part of a fit's 3D errors that a candidate effect explains."""
    train = before.after.train
    return None if train is None else train.rmse_mm * float(np.sqrt(max(candidate.explained_share, 0.0)))


@dataclass(frozen=True)
class FittedValue:
    """A fitted parameter of an effect, with its value, its sigma and the natural bound that it exceeds, if any."""

    effect: Effect
    parameter: Parameter
    name: str  # full
    value: float
    sigma: float
    bound: NaturalBound | None  # that it exceeds


def fitted_values(candidate: Candidate, calibration: Calibration) -> tuple[FittedValue, ...]:
    """The fitted parameters of an effect that are known to better than half their size, the surest first."""
    parameters, fitted = parameters_by_name(candidate.members), calibration.fit.by_name
    known = []
    for value in candidate.values:
        size, sigma = fitted.get(value.name, (0.0, np.inf))
        if abs(size) > _SIGNIFICANT * sigma:
            bound = exceeded_bound(*parameters[value.name], size, sigma)
            known.append(FittedValue(*parameters[value.name], value.name, size, sigma, bound))
    return tuple(sorted(known, key=lambda v: (abs(v.value) / v.sigma, v.name), reverse=True))
