"""Models of possible changes of a cell, each with the motion of the measured points per unit of change."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, IndexArray
from calib.effects.gravity import has_masses
from calib.effects.link_errors import LinkErrors
from calib.fitting.model import Model
from calib.fitting.observations import Observations
from calib.statistics import rms_length

JOINT_ZERO, TOOL, SCANNER, BASE = "joint_zero", "tool", "scanner", "base"
JIG = "jig"  # fixed in the world where the arm carries the scanner; takes the tool's place
LENGTH, ANGLE, COMPLIANCE, NOISE = "length", "angle", "compliance", "noise"
WARMTH, BACKLASH = "warmth", "backlash"
DRIFT, STEP = "drift", "step"
USUAL = (SCANNER, JOINT_ZERO, TOOL, JIG)

LARGEST_BY_UNIT = {"mm": 50.0, "rad": np.radians(10.0), "rad/Nm": 1e-3, "mm/N": 1.0, "ppm": 5000.0}
"""Size of a change, by its unit, from which the points have to move as it says: no part changes so much unseen."""


@dataclass(frozen=True)
class Change:
    """Estimate of one change of a cell, with its sigma and p-value."""

    what: str
    joint: int | None
    parameter: str
    size: float  # norm of `vector` where there is one
    sigma: float
    unit: str
    p_value: float
    as_well: tuple[str, ...]  # labels of changes that are confounded with this one at these poses
    vector: tuple[float, ...] = ()  # shift of the tool, tool frame, mm; shift (mm) and rotation (rad) of the scanner


@dataclass(frozen=True, eq=False)
class ChangeModel:
    """Linear model of one possible change of a cell: the motion of the measured points by K numbers."""

    what: str  # JOINT_ZERO, TOOL, ...
    joint: int | None  # from 1
    parameter: str  # of the robot's table; "" for other changes
    unit: str
    columns: Array  # (M, 3, K) motion of each measured point by one unit, mm in the base frame
    course: str = ""  # over a series of checks: DRIFT, STEP
    onset: int = 0  # index of the first check with a step
    places: int = 1  # number of onsets that are tried for this course

    @property
    def count(self) -> int:
        """Number K of the model's parameters."""
        return int(self.columns.shape[-1])

    def moves_mm(self, vector: Array) -> float:
        """RMS motion of the points by a change (K,), mm, the scanner at rest."""
        return rms_length(self.columns @ vector)

    @property
    def key(self) -> tuple[str, int | None, str]:
        """Identity of the change: its kind, joint and parameter."""
        return self.what, self.joint, self.parameter


def change_models_of_arm(model: Model, x: Array, observed: Observations) -> Iterator[ChangeModel]:
    """Models of changes of an arm: each joint's zero, lengths, link angles, compliance, backlash, warmth, and the tool.

    The tool is one change of three lengths, and so is the jig in the world where the arm carries the scanner. Warmth is
    one growth of all lengths. A joint's compliance needs masses in robot.toml, its backlash the side from which it
    was approached.

    Args:
        model: model of the earlier fit.
        x: (P,) its parameters.
        observed: points at which the motion is computed.
    """
    robot = model.robot
    table = Model(model.calibrated_robot(x), (LinkErrors(robot),))
    poses, row = observed.used_poses
    zeros = np.zeros(len(table.parameters))
    by_table = np.empty((len(row), 3, len(zeros)))
    for target, of_target in observed.targets.items():
        by_table[of_target] = table.linearise(zeros, poses, target)[1][row[of_target]]
    state = table.state(zeros, poses)
    torques_nm = state.gravity_torques_nm[row] if has_masses(robot) else np.zeros((len(row), 0))
    columns = {p.name: by_table[..., k] for k, p in enumerate(table.parameters)}  # (M, 3) by one unit of each
    approach = np.zeros((len(row), 0)) if poses.approach is None else poses.approach[row]
    units = dict(zip(robot.parameter_names, robot.parameter_units, strict=True))
    for joint, is_revolute in enumerate(robot.is_revolute, 1):
        zero = f"theta{joint}" if is_revolute else f"d{joint}"
        yield ChangeModel(JOINT_ZERO, joint, zero, "rad" if is_revolute else "mm", columns[zero][..., None])
        for name in (f"a{joint}", f"d{joint}", f"alpha{joint}", f"theta{joint}", f"beta{joint}"):
            # What lies behind the last joint is fixed to the flange: a change of it is one of the tool.
            if name != zero and joint < robot.n_joints:
                what = LENGTH if units[name] == "mm" else ANGLE
                yield ChangeModel(what, joint, name, units[name], columns[name][..., None])
        if torques_nm.shape[1]:
            unit = "rad/Nm" if is_revolute else "mm/N"
            by_torque = columns[zero] * torques_nm[:, joint - 1, None]
            yield ChangeModel(COMPLIANCE, joint, "", unit, by_torque[..., None])
        if approach.shape[1] and np.ptp(approach[:, joint - 1]) > 0.0:  # from one side alone it is a joint's zero
            half = 0.5 * columns[zero] * approach[:, joint - 1, None]
            yield ChangeModel(BACKLASH, joint, "", "rad" if is_revolute else "mm", half[..., None])
    values = dict(zip(robot.parameter_names, robot.table.ravel(), strict=True))
    grown = [1e-6 * values[name] * columns[name] for name in columns if units[name] == "mm" and values[name]]
    if grown:
        yield ChangeModel(WARMTH, None, "", "ppm", np.sum(grown, axis=0)[..., None])
    yield ChangeModel(JIG if robot.carries_scanner else TOOL, None, "", "mm", state.attitude[row])


def over_time(of_checks: Sequence[Sequence[ChangeModel]], times: Array, row: IndexArray) -> list[ChangeModel]:
    """Changes that all checks have, by all points, with their courses: a drift; usual ones with a step before each.

    Args:
        of_checks: models of each of S checks.
        times: (S,) of the checks.
        row: (M,) index of each point's check.
    """
    count, timed = len(times), []
    steps = [(STEP, k, (np.arange(count) >= k).astype(float), count) for k in range(count)]
    for model in of_checks[0]:
        same = [other for models in of_checks for other in models if other.key == model.key]
        if len(same) == count:
            columns = np.concatenate([one.columns for one in same])
            for course, onset, factor, places in ((DRIFT, 0, times, 1), *(steps if model.what in USUAL else ())):
                moved = columns * factor[row][:, None, None]
                timed.append(replace(model, columns=moved, course=course, onset=onset, places=places))
    return timed


def change_label(what: str, joint: int | None, parameter: str = "") -> str:
    """Label of a change: "joint_zero 3", "tool", "length a2"."""
    name = parameter if what in (LENGTH, ANGLE) else "" if joint is None else str(joint)
    return f"{what} {name}".strip()
