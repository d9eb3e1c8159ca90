"""The kinds of change that a cell may have gone through, and how each moves the measured points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.effects.gravity import has_masses
from calib.effects.link_errors import LinkErrors
from calib.fitting.model import Model
from calib.fitting.observations import Observations
from calib.kinematics.robot import Robot

JOINT_ZERO, TOOL, SCANNER, BASE = "joint_zero", "tool", "scanner", "base"
JIG = "jig"  # in the room, of an arm that carries the scanner: in the tool's place
LENGTH, ANGLE, COMPLIANCE, NOISE = "length", "angle", "compliance", "noise"


@dataclass(frozen=True)
class ChangeModel:
    """One change that may have happened, of K numbers."""

    what: str
    joint: int | None  # from 1
    parameter: str  # of the table, where it is one of those
    unit: str
    columns: Array  # (M, 3, K) how one unit of it moves each measured point, mm in the base frame

    @property
    def count(self) -> int:
        """K"""
        return int(self.columns.shape[-1])

    @property
    def key(self) -> tuple[str, int | None, str]:
        """What it is called by."""
        return self.what, self.joint, self.parameter


def kinds_of_the_arm(model: Model, x: Array, observed: Observations) -> tuple[ChangeModel, ...]:
    """Changes of the arm at the observed points: each joint's zero, length, link angle and compliance; the tool.

    The tool is one change of three lengths, and so is the jig in the room where the arm carries the scanner. A joint's
    compliance needs masses in robot.toml.
    """
    table = Model(model.calibrated_robot(x), (LinkErrors(model.robot),))
    poses, row = observed.used_poses
    by_table, torques = np.empty((len(row), 3, len(table.parameters))), np.zeros((len(row), 0))
    turn = np.empty((len(row), 3, 3))
    for target, of_target in observed.targets.items():
        at = table.linearise(np.zeros(len(table.parameters)), poses, target)[1]
        by_table[of_target] = at[row[of_target]]
    state = table.state(np.zeros(len(table.parameters)), poses)
    turn = state.attitude[row]
    torques = state.gravity_torques_nm[row] if has_masses(model.robot) else torques
    columns = {p.name: by_table[..., k] for k, p in enumerate(table.parameters)}
    return tuple(_kinds(model.robot, columns, torques, turn))


def _kinds(robot: Robot, columns: dict[str, Array], torques: Array, turn: Array) -> Iterator[ChangeModel]:
    for joint, is_revolute in enumerate(robot.is_revolute, 1):
        zero = f"theta{joint}" if is_revolute else f"d{joint}"
        yield ChangeModel(JOINT_ZERO, joint, zero, "rad" if is_revolute else "mm", columns[zero][..., None])
        for name in (f"a{joint}", f"d{joint}", f"alpha{joint}", f"theta{joint}", f"beta{joint}"):
            # What lies behind the last joint is fixed to the flange: a change of it is one of the tool.
            if name != zero and joint < robot.n_joints:
                length = name[0] in "ad" and not name.startswith("alpha")
                what, unit = (LENGTH, "mm") if length else (ANGLE, "rad")
                yield ChangeModel(what, joint, name, unit, columns[name][..., None])
        if torques.shape[1]:
            unit = "rad/Nm" if is_revolute else "mm/N"
            by_torque = columns[zero] * torques[:, joint - 1, None]
            yield ChangeModel(COMPLIANCE, joint, "", unit, by_torque[..., None])
    yield ChangeModel(JIG if robot.carries_scanner else TOOL, None, "", "mm", turn)


def kind_words(kind: ChangeModel) -> str:
    """ "joint_zero 3", "tool", "length a2"."""
    return kind_words_of(kind.what, kind.joint, kind.parameter)


def kind_words_of(what: str, joint: int | None, parameter: str = "") -> str:
    """The words of a kind (`kind_words`) by its parts."""
    named = parameter if what in (LENGTH, ANGLE) else "" if joint is None else str(joint)
    return f"{what} {named}".strip()
