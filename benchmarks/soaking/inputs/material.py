"""Good inputs of every kind, written once for a run: what is then spoiled."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import numpy as np

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.simulation.simulate import simulate_dataset
from inspector.cli.parser import main
from tests.support.chains import shoulder_arm
from tests.support.robot_texts import FRANKA, MJCF, UR10_CONF, UR_YAML
from tests.support.scan_mutations import WRITERS
from tests.support.scan_scene import make_scene

SCENES = 6
CELL_TABLES = """
[cell]
floor_z_mm = -50.0
least_manipulability = 0.01

[[cell.boxes]]
name = "cabinet"
min_mm = [900.0, 900.0, 0.0]
max_mm = [1200.0, 1200.0, 900.0]

[about]
serial = "RB5-17"
site = "hall 4"
date = "2024-05-17"
"""
EFFECT = '''"""An effect of the user's own."""
from dataclasses import dataclass

import numpy as np

from calib import Parameter


@dataclass(frozen=True)
class FifthHarmonic:
    joint: int = 2
    parameters = (
        Parameter("sin_rad", unit="rad", scale=1e-4),
        Parameter("cos_rad", unit="rad", scale=1e-4),
    )

    def apply(self, state, *, sin_rad, cos_rad):
        q_rad = state.q_rad[:, self.joint]
        return state.add_joint_error(self.joint, cos_rad * np.cos(5 * q_rad) + sin_rad * np.sin(5 * q_rad))
'''
XACRO = (
    '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">\n<xacro:property name="d" value="${0.1 + pi}"/>\n'
    '<xacro:macro name="j" params="n p">\n<link name="l${n}"/><joint name="j${n}" type="continuous"><parent '
    'link="${p}"/><child link="l${n}"/>\n<origin xyz="${d} 0 0.2"/></joint>\n</xacro:macro>\n<link name="b"/>\n'
    '<xacro:j n="1" p="b"/><xacro:j n="2" p="l1"/>\n<xacro:if value="${d > 1}"><xacro:j n="3" p="l2"/></xacro:if>\n'
    "</robot>\n"
)
ROBOTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "arm.urdf": (shoulder_arm(), ("--tip", "tool0")),
    "arm.xacro": (XACRO, ()),
    "arm.xml": (MJCF, ("--tip", "tcp")),
    "arm.yaml": (UR_YAML, ()),
    "arm.conf": (UR10_CONF, ("--model", "ur10")),
    "arm.csv": (FRANKA, ("--convention", "modified")),
}
"""By file name: a good robot, and the options that `convert` needs for it."""


def user_tables(dataset: Dataset) -> dict[str, str]:
    """A measurement as users write it, by the kind of its names and units."""
    assert dataset.points is not None
    q_rad, xyz_mm = dataset.poses.q, dataset.points.xyz_mm
    n = q_rad.shape[1]
    forms = {
        "our names": ([f"q{k}_deg" for k in range(1, n + 1)] + ["x_mm", "y_mm", "z_mm"], 180 / np.pi, 1.0),
        "brackets": ([f"J{k} [rad]" for k in range(1, n + 1)] + ["X [m]", "Y [m]", "Z [m]"], 1.0, 1e-3),
        "no units": ([f"joint_{k}" for k in range(1, n + 1)] + ["x", "y", "z"], 1.0, 1e-3),
    }
    out = {}
    for name, (header, angle, length) in forms.items():
        values = np.hstack([q_rad * angle, xyz_mm * length])
        rows = [
            ",".join([pose, *map(repr, map(float, row))]) for pose, row in zip(dataset.poses.ids, values, strict=True)
        ]
        out[name] = "\n".join([",".join(["pose", *header]), *rows]) + "\n"
    return out


def make(folder: Path) -> None:
    """Write everything below `folder`, once."""
    if (folder / "done").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    robot = builtin_robot("rb5")
    dataset = simulate_dataset(
        robot, rng=np.random.default_rng(18), poses=30, noise_mm=0.05, conditions=True, name="cell"
    ).dataset
    cell = folder / "cell"
    write_dataset(dataset, cell)
    (cell / "dataset.toml").write_text((cell / "dataset.toml").read_text() + CELL_TABLES)
    _run("calibrate", cell, "--model-out", folder / "model.json", "--session", folder / "session.json",
         "--add", "joint_compliance")  # fmt: skip
    session = json.loads((folder / "session.json").read_text())
    session["dataset"]["folder"] = "cell"
    (folder / "session.json").write_text(json.dumps(session, indent=1))
    (folder / "own_effect.py").write_text(EFFECT)
    (folder / "robots").mkdir()
    for name, (text, _) in ROBOTS.items():
        (folder / "robots" / name).write_text(text)
    (folder / "tables").mkdir()
    for name, text in user_tables(dataset).items():
        (folder / "tables" / f"{name}.csv").write_text(text)
    for number in range(SCENES):
        scene = make_scene(np.random.default_rng(number), 1500, field_mm=90)
        below = folder / "scans" / str(number)
        below.mkdir(parents=True)
        for name, write in WRITERS.items():
            (below / name).write_bytes(write(scene.scan.points_mm))
        _write_e57(below / "scan.e57", scene.scan.points_mm / 1000.0)
        np.savetxt(below / "apex_mm.txt", scene.apex_mm)
    (folder / "done").touch()


def _run(*arguments: object) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        code = main([*map(str, arguments)])
    assert code == 0, (code, arguments)


def _write_e57(path: Path, points_m: np.ndarray) -> None:
    from pye57 import E57

    with E57(str(path), mode="w") as file:
        data = {f"cartesian{axis}": column for axis, column in zip("XYZ", points_m.T, strict=True)}
        file.write_scan_raw(data, name="scan")
