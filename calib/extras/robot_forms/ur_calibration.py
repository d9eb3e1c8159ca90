"""Universal Robots' calibration.conf: corrections, six of each kind, of the nominal Denavit-Hartenberg table.

Standard Denavit-Hartenberg, metres and radians. As axes 2 to 4 are nearly parallel, the controller's d of them may
reach hundreds of metres; the robot that is made is the same arm with small numbers, each frame on its axis where it is
closest to the nominal one.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.kinematics.robot import Robot
from calib.robot_formats.chain.five_parameters import frames_at_zero, robot_of, row_transform
from calib.robot_formats.chain.serial_chain import ChainJoint, RobotFileError, SerialChain
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
_NUMBER = r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*"
_LINE = re.compile(rf"\w+\s*=\s*\[({_NUMBER}(?:,{_NUMBER})*)\]")
_FAR_MM = 50.0  # real arms are off by a few
_MOST_BYTES = 1024 * 1024
_MOST = 1e5  # m or rad


def read_conf(path: Path, reading: ReadOptions) -> RobotFile:
    """Robot of a calibration.conf of the model that the options name, with frames near their nominal places.

    Raises RobotFileError with file and line.
    """
    model = (reading.model or "").lower()
    if model not in MODELS:
        reason = f"--model {model} is not known" if model else "does not say which arm it is of"
        raise RobotFileError(f"{path}: {reason}; give --model, one of {', '.join(MODELS)}")
    nominal = nominal_rows(model)
    rows = nominal + _deltas(path) * [1.0, 1000.0, 1000.0, 1.0]
    note = (
        f"the controller's own table has a d of {np.abs(rows[:, 2]).max() / 1e3:.4g} m; this one is the same arm with "
        "each frame near its nominal place"
    )
    chain = replace(chain_of_standard(rows, f"{model.upper()} of {path.name}"), notes=(note,))
    near = chain_of_standard(nominal, model).at_zero[1:-1, :3, 3]
    robot = robot_of(chain, list(near))
    off_mm = np.linalg.norm(frames_at_zero(robot)[1:-2, :3, 3] - near, axis=1).max()
    if off_mm > _FAR_MM:
        raise RobotFileError(
            f"{path}: read as of a {model}, a joint is {off_mm:.0f} mm from its nominal place; give --model as the arm "
            f"is, one of {', '.join(MODELS)}"
        )
    return of_chain(chain, path, robot)


def nominal_robots() -> list[tuple[str, Robot]]:
    """Nominal arms of all models, by their names: models of one table together, as "UR5e or UR7e"."""
    names: dict[tuple[float, ...], list[str]] = {}
    for model, lengths in MODELS.items():
        names.setdefault(lengths, []).append(model.replace("ur", "UR"))
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


def _deltas(path: Path) -> Array:
    """Corrections (6, 4) of theta, a, d and alpha in section [mounting], rad and m. Raises RobotFileError."""
    text = read_bytes(path, _MOST_BYTES).decode("utf-8-sig", errors="replace")
    section, found, begins = "", dict[str, list[float]](), 1
    for number, line in enumerate(text.splitlines(), 1):
        line = re.sub(r"\s[#;].*$", "", line).strip()
        if line.startswith("["):
            section = line.strip("[] \t")
            begins = number if section == "mounting" else begins
        key = line.partition("=")[0].strip()
        if section != "mounting" or key not in _LISTS:
            continue
        match = _LINE.fullmatch(line)
        values = [float(word) for word in match[1].split(",")] if match else []
        if len(values) != 6 or max(map(abs, values)) > _MOST:
            raise RobotFileError(f"{path}: line {number}: {key}: found {line[:60]!r}; a list of six numbers is needed")
        if key in found:
            raise RobotFileError(f"{path}: line {number}: {key} stands there twice; remove one")
        found[key] = values
    missing = [key for key in _LISTS if key not in found]
    if missing:
        raise RobotFileError(
            f"{path}: line {begins}: section [mounting] has no {', '.join(missing)}; a controller's calibration.conf "
            "has all four"
        )
    return np.column_stack([found[key] for key in _LISTS])
