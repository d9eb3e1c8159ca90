"""Universal Robots' calibration.conf: corrections, six of each kind, of the nominal Denavit-Hartenberg table.

Standard Denavit-Hartenberg, metres and radians. As axes 2 to 4 are nearly parallel, the controller's d of them may
reach hundreds of metres; the robot that is made is the same arm with small numbers, each frame on its axis where it is
closest to the nominal one.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.frames import wrapped_angle
from calib.kinematics.robot import Robot
from calib.robot_formats.calibrated_file import CalibratedFile
from calib.robot_formats.chain.calibrated_origins import with_calibration
from calib.robot_formats.chain.five_parameters import frames_at_zero, robot_of, row_transform
from calib.robot_formats.chain.serial_chain import ChainJoint, RobotFileError, SerialChain, axis_frame
from calib.robot_formats.robot_file import ReadOptions, RobotFile, of_chain
from calib.robot_formats.urdf.safe_xml import read_bytes

# a2, a3, d1, d4, d5, d6 in metres: universal-robots.com, "DH parameters for calculations of kinematics and dynamics"
MODELS: dict[str, tuple[float, float, float, float, float, float]] = {
    "ur3": (-0.24365, -0.21325, 0.1519, 0.11235, 0.08535, 0.0819),
    "ur5": (-0.425, -0.39225, 0.089159, 0.10915, 0.09465, 0.0823),
    "ur10": (-0.612, -0.5723, 0.1273, 0.163941, 0.1157, 0.0922),
    "ur3e": (-0.24355, -0.2132, 0.15185, 0.13105, 0.08535, 0.0921),
    "ur5e": (-0.425, -0.3922, 0.1625, 0.1333, 0.0997, 0.0996),
    "ur10e": (-0.6127, -0.57155, 0.1807, 0.17415, 0.11985, 0.11655),
    "ur16e": (-0.4784, -0.36, 0.1807, 0.17415, 0.11985, 0.11655),
    "ur20": (-0.8620, -0.7287, 0.2363, 0.2010, 0.1593, 0.1543),
    "ur30": (-0.6370, -0.5037, 0.2363, 0.2010, 0.1593, 0.1543),
}
MODELS |= {"ur7e": MODELS["ur5e"], "ur12e": MODELS["ur10e"]}  # the same arms with more payload
_ALPHA = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)
_NAMES = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
_LISTS = ("delta_theta", "delta_a", "delta_d", "delta_alpha")
_LINE = re.compile(r"\s*(?P<key>\w+)\s*=\s*\[(?P<values>[^\]]*)\]\s*$")
_FAR_MM = 50.0  # real arms are off by a few
_MOST_BYTES = 1024 * 1024
_MOST = 1e5  # m or rad
_LOST_MM, _LOST_RAD = 1e-6, 1e-9  # of the flange, above which a note tells it
_PARALLEL = 1e-9  # sine of the angle of two axes below which any of their normals will do


def read_ur_calibration(path: Path, model: str | None) -> tuple[Robot, SerialChain]:
    """Robot of a calibration.conf, with frames near their nominal places, and the controller's own table as a chain.

    `model`: the type of the arm, which the file does not name. Raises RobotFileError with file and line.
    """
    if model is None or model.lower() not in MODELS:
        reason = "does not say which arm it is of" if model is None else f"--model {model} is not known"
        raise RobotFileError(f"{path}: {reason}; give --model, one of {', '.join(MODELS)}")
    deltas = _deltas(path)
    nominal = chain_of_standard(nominal_rows(model), model)
    rows = nominal_rows(model) + np.column_stack([deltas[key] for key in _LISTS]) * [1.0, 1000.0, 1000.0, 1.0]
    chain = chain_of_standard(rows, f"{model.upper()} of {path.name}")
    largest_m = float(np.abs(rows[:, 2]).max()) / 1e3
    note = (
        f"the controller's own table has a d of {largest_m:.4g} m; this one is the same arm with each frame near its "
        "nominal place"
    )
    chain = SerialChain(chain.name, chain.joints, chain.last_T_tip, notes=(note,))
    near = nominal.at_zero[1:-1, :3, 3]
    robot = robot_of(chain, list(near))
    off_mm = float(np.linalg.norm(frames_at_zero(robot)[1:-2, :3, 3] - near, axis=1).max())
    if off_mm > _FAR_MM:
        raise RobotFileError(
            f"{path}: read as of a {model}, a joint is {off_mm:.0f} mm from its nominal place; give --model as the arm "
            f"is, one of {', '.join(MODELS)}"
        )
    return robot, chain


def read_conf(path: Path, reading: ReadOptions) -> RobotFile:
    """Robot of a calibration.conf of the model that the options name. Raises RobotFileError with file and line."""
    robot, chain = read_ur_calibration(path, reading.model)
    return of_chain(chain, path, robot)


def nominal_robots() -> list[tuple[str, Robot]]:
    """Nominal arms of all models, by their names: models of one table together, as "UR5e or UR7e"."""
    names: dict[tuple[float, ...], list[str]] = {}
    for model, lengths in MODELS.items():
        names.setdefault(lengths, []).append(f"{model.removesuffix('e').upper()}{'e' if model.endswith('e') else ''}")
    return [
        (" or ".join(named), robot_of(chain_of_standard(nominal_rows(named[0]), named[0]))) for named in names.values()
    ]


def nominal_rows(model: str) -> Array:
    """Nominal table (6, 4) of a model: theta, a, d, alpha in rad and mm."""
    a2, a3, d1, d4, d5, d6 = MODELS[model.lower()]
    a, d = [0.0, a2, a3, 0.0, 0.0, 0.0], [d1, 0.0, 0.0, d4, d5, d6]
    return np.column_stack([np.zeros(6), 1e3 * np.array(a), 1e3 * np.array(d), _ALPHA])


def chain_of_standard(rows: Array, name: str) -> SerialChain:
    """Chain of a standard Denavit-Hartenberg table (6, 4); row i leads from axis i to axis i + 1."""
    ends = [row_transform((a_mm, alpha, d_mm, theta, 0.0)) for theta, a_mm, d_mm, alpha in rows]
    joints = [ChainJoint(label, before) for label, before in zip(_NAMES, [np.eye(4), *ends[:-1]], strict=True)]
    return SerialChain(name, tuple(joints), ends[-1])


def _deltas(path: Path) -> dict[str, list[float]]:
    """The four lists of corrections in section [mounting], by name. Raises RobotFileError."""
    text = read_bytes(path, _MOST_BYTES).decode("utf-8-sig", errors="replace")
    section, found, begins = "", {}, 1
    for number, line in enumerate(text.splitlines(), 1):
        line = re.sub(r"\s[#;].*$", "", line).strip()
        if line.startswith("["):
            section = line.strip("[] \t")
            begins = number if section == "mounting" else begins
            continue
        key = line.partition("=")[0].strip()
        if section != "mounting" or key not in _LISTS:
            continue
        match = _LINE.match(line)
        values = [_number(word) for word in match["values"].split(",")] if match else []
        if len(values) != 6 or any(value is None for value in values):
            raise RobotFileError(f"{path}: line {number}: {key}: found {line[:60]!r}; a list of six numbers is needed")
        if key in found:
            raise RobotFileError(f"{path}: line {number}: {key} stands there twice; remove one")
        found[key] = [value for value in values if value is not None]
    missing = [key for key in _LISTS if key not in found]
    if missing:
        raise RobotFileError(
            f"{path}: line {begins}: section [mounting] has no {', '.join(missing)}; a controller's calibration.conf "
            "has all four"
        )
    return found


@dataclass(frozen=True)
class UrTable:
    """Standard Denavit-Hartenberg table of a UR arm, and what of its flange such a table cannot hold."""

    rows: Array  # (6, 4) theta, a, d, alpha, rad and mm
    lost_mm: float  # of the flange, across the last axis
    lost_rad: float  # of the flange's axis against the last one


def table_of_chain(chain: SerialChain, near: Array) -> UrTable:
    """Standard Denavit-Hartenberg table of a chain of six joints, each angle as near as can be to `near` (6, 4).

    Row i leads from axis i to axis i + 1 along their common normal, however far off that is for axes that are nearly
    parallel: there the controller's numbers are as large. The last row has neither a nor alpha, as on the controller.
    """
    at_zero = chain.at_zero
    axes = [frame @ axis_frame(joint) for frame, joint in zip(at_zero[:-1], chain.joints, strict=True)]
    x_before, place = np.eye(3)[0], np.zeros(3)
    rows = []
    for axis, after, nominal in zip(axes, axes[1:], near, strict=False):
        along, next_along = axis[:3, 2], after[:3, 2]
        between = after[:3, 3] - axis[:3, 3]
        across = np.cross(along, next_along)
        sine = float(np.linalg.norm(across))
        if sine > _PARALLEL:
            x = across / sine
            ends = axis[:3, 3] + along * float(np.linalg.det([between, next_along, across])) / sine**2
            begins = after[:3, 3] + next_along * float(np.linalg.det([between, along, across])) / sine**2
        else:
            flat = between - along * (along @ between)
            x = flat / np.linalg.norm(flat)
            ends = place + along * nominal[2]
            begins = after[:3, 3] + next_along * (next_along @ (ends - after[:3, 3]))
        theta = _angle(x_before, x, along)
        if abs(wrapped_angle(theta - nominal[0])) > 0.5 * math.pi:  # of the two directions of a normal
            x, theta = -x, wrapped_angle(theta + math.pi)
        rows.append([theta, float(x @ (begins - ends)), float(along @ (ends - place)), _angle(along, next_along, x)])
        x_before, place = x, begins
    along, tip = axes[-1][:3, 2], at_zero[-1]
    off_mm = tip[:3, 3] - place
    rows.append([_angle(x_before, tip[:3, 0], along), 0.0, float(along @ off_mm), 0.0])
    lost_mm = float(np.linalg.norm(off_mm - along * (along @ off_mm)))
    return UrTable(np.array(rows), lost_mm, float(np.arccos(np.clip(along @ tip[:3, 2], -1.0, 1.0))))


def _angle(one: Array, other: Array, about: Array) -> float:
    """Angle, rad, by which one vector (3,) turns into another about an axis (3,)."""
    return math.atan2(float(np.cross(one, other) @ about), float(one @ other - (one @ about) * (other @ about)))


def with_deltas(text: str, table: UrTable, model: str) -> tuple[str, tuple[str, ...]]:
    """Text of a calibration.conf with the corrections of a table, all else unchanged; and the keys that changed."""
    off = table.rows - nominal_rows(model)
    values = {
        "delta_theta": [wrapped_angle(angle) for angle in off[:, 0]],
        "delta_a": (1e-3 * off[:, 1]).tolist(),
        "delta_d": (1e-3 * off[:, 2]).tolist(),
        "delta_alpha": [wrapped_angle(angle) for angle in off[:, 3]],
    }
    section, lines, changed = "", [], []
    for line in text.splitlines(keepends=True):
        if line.strip().startswith("["):
            section = re.sub(r"\s[#;].*$", "", line.strip()).strip("[] \t")
        key = line.partition("=")[0].strip()
        if section == "mounting" and key in values:
            new = re.sub(r"\[[^\]]*\]", f"[{', '.join(map(repr, values[key]))}]", line, count=1)
            changed += [key] if new != line else []
            line = new
        lines.append(line)
    return "".join(lines), tuple(changed)


def calibrated_conf(
    template: Path, calibrated: Robot, nominal: Robot | None = None, comment: str = ""
) -> CalibratedFile:
    """A UR controller's calibration.conf with calibrated corrections, all else unchanged, so that it gets no comment.

    The arm's model is the one with which the file has the axes of the nominal robot. Arguments as of `calibrated_urdf`.
    Raises RobotFileError where there is none.
    """
    failed: RobotFileError | None = None
    for model in MODELS:
        try:
            _, chain = read_ur_calibration(template, model)
            found = with_calibration(chain, nominal, calibrated)
        except RobotFileError as error:
            failed = failed or error
            continue
        table = table_of_chain(found.chain, nominal_rows(model))
        text, changed = with_deltas(template.read_bytes().decode("utf-8-sig"), table, model)
        notes = ["a controller takes the file back only as its maker says; keep the one that it had"]
        if not found.tip_known:
            notes.append("the tool is no part of a calibration.conf")
        if table.lost_mm >= _LOST_MM or table.lost_rad >= _LOST_RAD:
            notes.append(
                f"the calibrated flange is {table.lost_mm:.3g} mm off the last axis and tilted by "
                f"{np.degrees(table.lost_rad):.3g} deg, for which the controller has no number: it is lost"
            )
        if found.chain.tool_point_mm is not None:
            notes.append("the measured point is no part of a calibration.conf")
        return CalibratedFile(text.encode(), changed, tuple(notes))
    raise RobotFileError(
        f"{template}: read as of none of {', '.join(MODELS)} has it the axes of robot.toml; give the calibration.conf "
        f"from which that was imported ({failed})"
    )


def _number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if abs(value) <= _MOST and "_" not in word else None
