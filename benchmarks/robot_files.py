"""Every arm of every URDF below a folder, imported, beside MuJoCo's or Pinocchio's reading of the same file.

    python benchmarks/robot_files.py FOLDER [--oracle mujoco|pinocchio] [--vectors 100] [--tips 20] [--tell]

For each file and each of its tips: the tool's place and attitude by robot.toml, written and read again, at random joint
vectors; gravity's torques where the file has masses; and whether the file comes back byte for byte where nothing is
calibrated. MuJoCo gets the file without shapes, with joints beside the arm fixed and other inertias, as many files have
some that no body can have; links without mass get one, and torques are then not compared. Pinocchio (`pip install pin`)
gets the file as it is.
"""

from __future__ import annotations

import argparse
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import simulated  # noqa: F401  (sets the paths)

from calib.dataset.files.robot_toml import load_robot_toml, robot_to_toml
from calib.effects.gravity import GravityLoads
from calib.errors import CalibError
from calib.frames import invert, make_transform
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot
from calib.robot_formats.calibrated_file import calibrated_urdf
from calib.robot_formats.robot_file import ReadOptions, read_arm, read_robot
from calib.robot_formats.urdf.chain import ArmPath

UNIT_INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'


@dataclass
class Worst:
    """Largest deviations over all arms."""

    arms: int = 0
    weighed: int = 0  # of them with torques compared
    place_mm: float = 0.0
    attitude: float = 0.0
    torque_nm: float = 0.0
    changed: int = 0  # files that did not come back as they were


# Joint values (n,), rad or m -> base_T_tip (4, 4) mm, and gravity's generalized forces (n,) in Nm or N.
Oracle = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def by_mujoco(arm: ArmPath, robot: Robot) -> Oracle:
    """MuJoCo's answers."""
    import mujoco

    model = mujoco_model(arm)
    data, joints = mujoco.MjData(model), [model.joint(joint.name) for joint in robot.joints]
    qpos, dof = [int(joint.qposadr[0]) for joint in joints], [int(joint.dofadr[0]) for joint in joints]

    def answer(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        data.qpos[qpos] = q
        mujoco.mj_forward(model, data)
        body = data.body(arm.tip)
        return make_transform(body.xmat.reshape(3, 3), 1e3 * body.xpos), data.qfrc_bias[dof].copy()

    return answer


def by_pinocchio(arm: ArmPath, robot: Robot) -> Oracle:
    """Pinocchio's answers."""
    import pinocchio

    model = pinocchio.buildModelFromXML(arm.tree.file.content.decode())
    data, neutral = model.createData(), pinocchio.neutral(model)
    joints = [model.joints[model.getJointId(joint.name)] for joint in robot.joints]
    ends = [model.getFrameId(name, pinocchio.FrameType.BODY) for name in (arm.base, arm.tip)]

    def answer(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values = neutral.copy()
        for joint, value in zip(joints, q, strict=True):
            turns_on = joint.nq == 2  # a continuous joint is a point of the circle
            values[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(value), np.sin(value)] if turns_on else value
        pinocchio.framesForwardKinematics(model, data, values)
        base, tip = (data.oMf[end].homogeneous for end in ends)
        place = invert(base) @ tip
        place[:3, 3] *= 1e3
        pulls = pinocchio.computeGeneralizedGravity(model, data, values)
        return place, pulls[[joint.idx_v for joint in joints]]

    return answer


ORACLES = {"mujoco": by_mujoco, "pinocchio": by_pinocchio}


def mujoco_model(arm: ArmPath) -> Any:
    """MuJoCo's model of the arm's file."""
    import mujoco

    root = ET.fromstring(arm.tree.file.content)
    moving = {joint.name for joint in arm.moving}
    for link in root.iter("link"):
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                link.remove(shape)
        inertial = link.find("inertial")
        mass = None if inertial is None else inertial.find("mass")
        if inertial is None or mass is None or float(mass.get("value", "0")) < 1e-14:
            for part in link.findall("inertial"):
                link.remove(part)
            link.append(ET.fromstring(f'<inertial><mass value="1e-14"/>{UNIT_INERTIA}</inertial>'))
        else:
            for inertia in inertial.findall("inertia"):
                inertial.remove(inertia)
            inertial.append(ET.fromstring(UNIT_INERTIA))
    for joint in root.findall("joint"):
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
        if joint.get("name") not in moving:
            joint.set("type", "fixed")
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    spec.compiler.fusestatic = False
    return spec.compile()


def compare(path: Path, tip: str | None, oracle: str, vectors: int, worst: Worst, folder: Path) -> None:
    """Compare one arm of one file with the peer's reading of it."""
    reading = ReadOptions(tip=tip)
    found, arm = read_robot(path, reading), read_arm(path, tip=tip)
    (folder / "robot.toml").write_text(robot_to_toml(found.robot))
    robot = load_robot_toml(folder / "robot.toml")
    worst.arms += 1
    worst.changed += calibrated_urdf(path, robot).content != path.read_bytes()
    answer = ORACLES[oracle](arm, robot)
    q = np.random.default_rng(0).uniform(-2, 2, (vectors, robot.n_joints)) * np.where(robot.is_revolute, 1, 300)
    chain = nominal_chain(robot, q)
    weighed = all(joint.mass_kg is not None for joint in robot.joints)
    torques = GravityLoads(robot, chain, None).joint_torques
    for k, values in enumerate(q):
        theirs, pulls = answer(np.where(robot.is_revolute, values, values / 1e3))
        mine = chain.base_T_frame[k, -1]
        worst.place_mm = max(worst.place_mm, float(np.abs(mine[:3, 3] - theirs[:3, 3]).max()))
        worst.attitude = max(worst.attitude, float(np.abs(mine[:3, :3] - theirs[:3, :3]).max()))
        if weighed:
            worst.torque_nm = max(worst.torque_nm, float(np.abs(torques[k] + pulls).max()))
    worst.weighed += weighed


def tips_of(path: Path, most: int) -> list[str | None]:
    """The tips to take; None: the file has one only."""
    try:
        read_arm(path)
    except CalibError as error:
        _, several, listed = str(error).partition("choose one with --tip: ")
        if not several:
            raise
        return [name.strip() for name in listed.partition(" and ")[0].split(",")][:most]
    return [None]


def main() -> None:
    """Read the command line, compare, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--oracle", choices=ORACLES, default="mujoco")
    parser.add_argument("--vectors", type=int, default=100)
    parser.add_argument("--tips", type=int, default=20, help="of a file, at the most")
    parser.add_argument("--tell", action="store_true", help="every refusal")
    given = parser.parse_args()
    worst, refused, files = Worst(), Counter[str](), 0
    with tempfile.TemporaryDirectory() as made:
        for path in sorted(given.folder.rglob("*.urdf")):
            files += 1
            try:
                tips = tips_of(path, given.tips)
            except CalibError as error:
                tips = []
                refused[str(error).split(": ")[-1]] += 1
                print(error) if given.tell else None
            for tip in tips:
                try:
                    compare(path, tip, given.oracle, given.vectors, worst, Path(made))
                except CalibError as error:
                    refused[str(error).split("; ")[-1]] += 1
                    print(error) if given.tell else None
                except (ValueError, ET.ParseError) as error:
                    print(f"{given.oracle} cannot read {path.name}: {error}")
    print(f"{files} files, {worst.arms} arms, {sum(refused.values())} refused:")
    for words, times in refused.most_common():
        print(f"  {times:4d}  {words[:110]}")
    print(f"place {worst.place_mm:.1e} mm, attitude {worst.attitude:.1e} at worst")
    print(f"torques of {worst.weighed} arms with masses {worst.torque_nm:.1e} Nm at worst")
    print(f"{worst.changed} files changed by an export of nothing")


if __name__ == "__main__":
    main()
