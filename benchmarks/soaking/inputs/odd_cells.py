"""Datasets that are well formed and odd: one joint, one pose, test poses alone, constant conditions, no noise.

Each is given to a command of those that fit, judge, compare or plan; it answers, or says in one line why it cannot.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from calib.dataset.files.robot_toml import robot_to_toml
from calib.kinematics.chain import target_points
from calib.kinematics.robot import Joint, Robot, Tool
from soaking.inputs.commands import Ran, ran
from soaking.inputs.odd_values import Rng
from soaking.record import Result

JOINTS = {1: 25, 2: 25, 3: 10, 4: 10, 6: 20, 7: 10}
POSES = {1: 6, 2: 6, 3: 8, 4: 8, 6: 10, 9: 12, 15: 20, 30: 20, 60: 10}
ODD_COLUMNS = ("torque1_nm", "link_q1_deg", "temperature_motor_c", "load_table_q1_deg", "q1", "q01_deg", "q9_deg",
               "torque1", "torque9", "approach_1", "approach9", "x", "order", "q1-q2", "hour")  # fmt: skip
EFFECTS = (
    "joint_compliance",
    "backlash",
    "thermal_growth",
    "transmission_error",
    "scanner_scale",
    "joint_scale",
)
COMMANDS = {
    "calibrate": 12, "diagnose": 10, "check": 8, "redundancy": 4, "plan": 12, "validate": 6, "report": 6, "correct": 8,
    "watch": 8, "compare": 4, "calibrate and validate": 6, "diagnose and validate": 6, "watch another": 5,
    "compare another": 4, "fleet": 1,
}  # fmt: skip
"""By command that reads the dataset: how often of 100."""


def attempt(number: int, rng: Rng, scratch: Path) -> Result:
    """Run one case."""
    cell = scratch / "cells" / "cell"
    words = write_cell(rng, cell)
    command = str(rng.choice([*COMMANDS], p=np.array([*COMMANDS.values()]) / sum(COMMANDS.values())))
    result = run(rng, command, cell, scratch)
    return Result(number, "odd cell", f"{words}; {command}", str(result.code), result.trouble, result.said)


def run(rng: Rng, command: str, cell: Path, scratch: Path) -> Ran:
    """A command on a dataset, with options of its own."""
    out, model = scratch / "out", scratch / "out" / "model.json"
    residual = ("--residual", str(rng.choice(["position", "distance", "pairs"])))
    if command == "calibrate":
        more = [residual, ("--no-prior",), ("--robust",), ("--effect", str(rng.choice(EFFECTS))),
                ("--add", str(rng.choice(EFFECTS))),
                ("--session", out / "s.json", "--residuals", out / "r.csv")]  # fmt: skip
        return ran(scratch, command, cell, "--json", *_some(rng, more), outputs=(out,))
    if command in ("calibrate and validate", "diagnose and validate"):
        first = ran(scratch, command.split()[0], cell, "--json", "--model-out", model, outputs=(out,))
        if first.trouble or first.code == 2:
            return first
        if rng.random() < 0.5:
            return ran(scratch, "validate", cell, "--model", model, "--json")
        arguments = ("--model", model, "--joints", cell / "poses.csv", "--out", out / "c.csv")
        return ran(scratch, "correct", cell, *arguments, outputs=(out,))
    if command in ("watch another", "compare another"):
        other = cell.with_name("other")
        write_cell(rng, other)
        return ran(scratch, command.split()[0], cell, other, "--json")
    arguments: dict[str, tuple[object, ...]] = {
        "plan": ("plan", cell, "--json", *_plan(rng)),
        "report": ("report", cell, "--out", out / "report.html"),
        "correct": ("correct", cell, "--joints", cell / "poses.csv", "--out", out / "c.csv",
                    *_some(rng, [("--force",)])),
        "watch": ("watch", cell, cell, "--json", *_some(rng, [("--scanner-moved",), ("--out", out / "w.html")])),
        "compare": ("compare", cell, cell, "--json", *residual),
        "fleet": ("fleet", cell.parent, "--workers", 1, "--out", out / "fleet.csv", "--json"),
    }  # fmt: skip
    return ran(scratch, *arguments.get(command, (command, cell, "--json")), outputs=(out,))


def _plan(rng: Rng) -> tuple[object, ...]:
    purpose = str(rng.choice(["calibration", "split", "watch", *EFFECTS]))
    return ("--for", purpose, *(("--add", int(rng.integers(1, 5))) if rng.random() < 0.5 else ()))


def _some(rng: Rng, options: list[tuple[object, ...]]) -> tuple[object, ...]:
    return tuple(word for option in options if rng.random() < 0.25 for word in option)


def write_cell(rng: Rng, folder: Path) -> str:
    """Write a dataset at `folder` and return what is odd about it."""
    robot = _robot(rng)
    poses = _drawn(rng, POSES)
    q = _joint_values(rng, robot, poses)
    oddities: list[str] = [f"{robot.n_joints} joints", f"{poses} poses"]

    def oddly(name: str, share: float) -> bool:
        happens = bool(rng.random() < share)
        oddities.extend([name] if happens else [])
        return happens

    noise_mm = 0.0 if oddly("no noise", 0.15) else 1e4 if oddly("noise of metres", 0.05) else 0.05
    role = np.where(rng.random(poses) < 0.2, "test", "train").astype(object)
    if oddly("all test poses", 0.1):
        role[:] = "test"
    role[int(rng.integers(poses))] = "reference"
    setup = np.full(poses, "a", dtype=object)
    if oddly("a place of the scanner without training poses", 0.15):
        setup[role == "test"] = "b"
    elif oddly("many places of the scanner", 0.1):
        setup = rng.choice(["a", "b", "c"], poses).astype(object)
    columns = _conditions(rng, oddly, poses, robot.n_joints)
    measured = np.repeat(np.arange(poses), 1 + (rng.random(poses) < 0.2))
    if oddly("half of the poses not measured", 0.1):
        measured = measured[: max(len(measured) // 2, 1)]
    xyz_mm = target_points(robot, q)[measured]
    xyz_mm = xyz_mm + noise_mm * rng.normal(size=xyz_mm.shape) + [300.0, 20.0, 700.0]
    if oddly("points all in one place", 0.03):
        xyz_mm[:] = 5.0
    if oddly("points a light second away", 0.03):
        xyz_mm += 1e9
    targets = oddly("a target without points", 0.1)
    declared = "" if oddly("no noise declared", 0.3) else f"point_sigma_mm = {rng.choice([1e-6, 0.05, 0.05, 30.0])}\n"
    extra_targets = '\n[[targets]]\nname = "ball"\nxyz_mm = [1.0, 2.0, 3.0]\n' if targets else ""
    folder.mkdir(parents=True)
    (folder / "robot.toml").write_text(robot_to_toml(robot) + extra_targets)
    (folder / "dataset.toml").write_text(
        'format = 1\nname = "odd"\nrobot = "robot.toml"\nposes = "poses.csv"\npoints = "points.csv"\n'
        f"[scanner]\n{declared}"
    )
    of_joints = [f"q{k}_{'deg' if j.is_revolute else 'mm'}" for k, j in enumerate(robot.joints, 1)]
    shown = np.where(robot.is_revolute, np.degrees(q), q)
    rows = [
        [
            f"p{i}",
            role[i],
            setup[i],
            *map(repr, shown[i].tolist()),
            *(str(values[i]) for values in columns.values()),
        ]
        for i in range(poses)
    ]
    _write_csv(folder / "poses.csv", [["pose", "role", "setup", *of_joints, *columns], *rows])
    points = [[f"p{i}", *map(repr, place)] for i, place in zip(measured, xyz_mm.tolist(), strict=True)]
    _write_csv(folder / "points.csv", [["pose", "x_mm", "y_mm", "z_mm"], *points])
    return ", ".join(oddities)


def _conditions(rng: Rng, oddly: Callable[[str, float], bool], poses: int, joints: int) -> dict[str, np.ndarray]:
    out: dict[str, np.ndarray] = {}
    if rng.random() < 0.4:
        constant = oddly("temperature constant", 0.5)
        out["temperature_c"] = np.full(poses, 20.0) if constant else rng.uniform(15, 35, poses)
    if rng.random() < 0.4:
        time_s = np.sort(rng.uniform(0, 4e3, poses))
        out["time_s"] = rng.permutation(time_s) if oddly("time not increasing", 0.4) else time_s
        if oddly("all at one time", 0.2):
            out["time_s"] = np.zeros(poses)
    if rng.random() < 0.3:
        out["payload_kg"] = rng.choice([0.0, 2.0], poses)
    if rng.random() < 0.3:
        out |= {f"approach{k}": rng.choice([-1, 1], poses) for k in range(1, joints + 1)}
    for name in ODD_COLUMNS:
        if oddly(name, 0.06):
            words = rng.choice(["red", "blue", ""], poses)
            out[name] = words if rng.random() < 0.2 else rng.normal(size=poses) * 10.0 ** rng.uniform(-9, 9)
    return out


def _robot(rng: Rng) -> Robot:
    count = _drawn(rng, JOINTS)
    masses = rng.choice(["none", "some", "zero"])

    def mass() -> float | None:
        return None if masses == "none" else 0.0 if masses == "zero" else float(rng.uniform(0, 8))

    prismatic = rng.random(count) < (0.3 if rng.random() < 0.3 else 0.0)
    joints = tuple(
        Joint(
            a_mm=float(rng.choice([0.0, rng.uniform(0, 400)])),
            alpha_rad=float(rng.choice([-np.pi / 2, 0.0, np.pi / 2])),
            d_mm=float(rng.choice([0.0, rng.uniform(-200, 400)])),
            name=f"J{k + 1}",
            type="prismatic" if prismatic[k] else "revolute",
            mass_kg=mass(),
            com_mm=None if masses == "none" else (0.0, 10.0, 20.0),
        )
        for k in range(count)
    )
    return Robot("odd arm", joints, Tool(a_mm=float(rng.choice([0.0, 80.0])), d_mm=float(rng.choice([0.0, 90.0]))))


def _joint_values(rng: Rng, robot: Robot, poses: int) -> np.ndarray:
    span = np.where(robot.is_revolute, 2.0, 500.0)
    q = rng.uniform(-span, span, (poses, robot.n_joints))
    kind = rng.random()
    if kind < 0.1:
        q[:, int(rng.integers(robot.n_joints))] = 0.3  # a joint that never moves
    elif kind < 0.15:
        q[:] = q[0]
    elif kind < 0.2:
        q *= 40.0  # hundreds of turns
    return q


def _drawn(rng: Rng, counts: dict[int, int]) -> int:
    share = np.array([*counts.values()], dtype=float)
    return int(rng.choice([*counts], p=share / share.sum()))


def _write_csv(path: Path, rows: list[list[str]]) -> None:
    path.write_text("\n".join(",".join(map(str, row)) for row in rows) + "\n")
