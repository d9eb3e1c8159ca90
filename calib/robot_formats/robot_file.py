"""Reading of a robot from a file of any supported format, by its suffix."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.dataset.files.robot_toml import builtin_robot, load_robot_toml, refuse_beyond
from calib.errors import is_one_line
from calib.frames import invert
from calib.kinematics.chain import forward
from calib.kinematics.robot import Robot
from calib.options import BUILTIN_ROBOTS
from calib.robot_formats.chain.five_parameters import frames_at_zero, robot_of
from calib.robot_formats.chain.serial_chain import RobotFileError, SerialChain, chain_frames
from calib.robot_formats.mjcf import chain_of_mjcf
from calib.robot_formats.origin_yaml import chain_of_yaml, read_origin_yaml
from calib.robot_formats.tables import chain_of_table
from calib.robot_formats.ur_calibration import read_ur_calibration
from calib.robot_formats.urdf.chain import ArmPath, chain_of_arm, find_arm, tip_links
from calib.robot_formats.urdf.meshes import MeshFile, Packages, link_meshes
from calib.robot_formats.urdf.safe_xml import XmlFile, parse_xml, read_bytes
from calib.robot_formats.urdf.tree import read_tree
from calib.robot_formats.urdf.xacro import Xacro, expanded_xacro

SOURCE = "source"  # the table of robot.toml that says which file and links it was made of
SUFFIXES = (".toml", ".urdf", ".xml", ".yaml", ".yml", ".conf", ".csv", ".xacro")
_GONE = {  # forms that are not read, with what to give instead
    ".sdf": "SDF is not read; give the arm's URDF",
    ".srdf": "an SRDF is not read; give the arm's URDF, and the links of the group as --base and --tip",
}


@dataclass(frozen=True)
class RobotFile:
    """A robot that was read, with the chain from which its table was made (None for a robot.toml) and notes."""

    robot: Robot
    chain: SerialChain | None
    notes: tuple[str, ...] = ()
    meshes: tuple[tuple[MeshFile, ...], ...] = ()  # (n,) of each joint's link, in its frame of robot.toml

    @property
    def summary(self) -> str:
        """Robot, accuracy of the conversion and notes, a line each."""
        names = ", ".join(joint.name for joint in self.robot.joints)
        lines = [f"{self.robot.name}: {self.robot.n_joints} joints ({names})"]
        if self.chain is not None:
            if self.chain.tip:
                lines[0] += f" from {self.chain.base} to {self.chain.tip}"
            lines.append(
                f"the table reaches the file's own places to {conversion_error_mm(self.robot, self.chain):.1e} mm"
            )
        lines += [f"note: {note}" for note in self.notes]
        return "\n".join(lines)


@dataclass(frozen=True)
class ReadOptions:
    """Options for what a robot's file does not define: tip, base, convention, model, xacro arguments."""

    tip: str | None = None  # link, body or site
    base: str | None = None
    convention: str | None = None  # of a table of theta, d, a, alpha: "standard" or "modified"
    model: str | None = None  # of a UR controller's calibration.conf
    xacro: Xacro | None = None  # None: a xacro is refused, as it computes and reads other files
    packages: Packages | None = None  # folders of ROS packages with meshes; None: none is looked for


def read_robot(path: str | Path, reading: ReadOptions = ReadOptions()) -> RobotFile:
    """Read the robot of a file, by its suffix.

    Raises CalibError in one line that names the file, the line or key, and a remedy.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in _GONE:
        raise RobotFileError(f"{path}: {_GONE[suffix]}")
    if suffix not in SUFFIXES:
        found = suffix or "no suffix"
        raise RobotFileError(f"{path}: {found} is no form of a robot; expected {', '.join(SUFFIXES)}")
    _refuse_unused(path, suffix, reading)
    if suffix == ".toml":
        robot = load_robot_toml(path)
        refuse_beyond(robot, path)
        return RobotFile(robot, None)
    if suffix == ".conf":
        robot, chain = read_ur_calibration(path, reading.model)
        return _with_source(robot, chain, path)
    if suffix == ".csv":
        chain = chain_of_table(path, reading.convention)
    elif suffix in (".yaml", ".yml"):
        chain = chain_of_yaml(read_origin_yaml(path))
    else:
        file = read_xml(path, reading.xacro)
        if file.root.tag == "mujoco":
            chain = chain_of_mjcf(file, reading.tip, reading.base)
        else:
            return _of_arm(find_arm(read_tree(file), reading.tip, reading.base), path, reading.packages)
    return _with_source(robot_of(chain), chain, path)


def _of_arm(arm: ArmPath, path: Path, packages: Packages | None) -> RobotFile:
    """Robot of a tree of links, with its meshes in the frames of robot.toml."""
    chain = chain_of_arm(arm)
    read = _with_source(robot_of(chain), chain, path)
    found = link_meshes(arm, packages)
    in_table = invert(frames_at_zero(read.robot)[1:-1]) @ chain.at_zero[:-1]
    meshes = tuple(
        tuple(replace(one, link_T_mesh=place @ one.link_T_mesh) for one in files)
        for place, files in zip(in_table, found.of_joint, strict=True)
    )
    return replace(read, notes=(*read.notes, *found.notes), meshes=meshes if any(meshes) else ())


def tips_of(path: Path) -> tuple[str, ...]:
    """Possible tip links of a URDF, the tip of the longest arm first; () for other formats. Raises CalibError."""
    if path.suffix.lower() not in (".urdf", ".xml", ".xacro"):
        return ()
    file = read_xml(path)
    if file.root.tag == "mujoco":
        return ()
    return tuple(tip_links(read_tree(file)))


def named_robot(name: str, reading: ReadOptions = ReadOptions()) -> RobotFile:
    """Read a robot by the name of a built-in one or by its file. Raises CalibError."""
    if name in BUILTIN_ROBOTS:
        return RobotFile(builtin_robot(name), None)
    return read_robot(Path(name), reading)


def read_xml(path: Path, xacro: Xacro | None = None) -> XmlFile:
    """Parsed XML file, a .xacro expanded where that is allowed. Raises CalibError."""
    if xacro is not None and path.suffix.lower() == ".xacro":
        return expanded_xacro(path, xacro)
    return parse_xml(path, read_bytes(path))


def read_arm(path: Path, *, tip: str | None = None, base: str | None = None) -> ArmPath:
    """The arm in a URDF, for changing its origins. Raises CalibError."""
    return find_arm(read_tree(read_xml(path)), tip, base)


def source_links(robot: Robot) -> tuple[str | None, str | None]:
    """Tip and base links of the file from which robot.toml was made; None where not recorded."""
    source = robot.extra.get(SOURCE)
    if not isinstance(source, dict):
        return None, None
    tip, base = source.get("tip"), source.get("base")
    return (tip if isinstance(tip, str) else None, base if isinstance(base, str) else None)


def conversion_error_mm(robot: Robot, chain: SerialChain) -> float:
    """Largest distance, mm, between the tips of table and chain over 20 joint vectors."""
    span = np.where(robot.is_revolute, np.pi, 500.0)
    q = np.random.default_rng(0).uniform(-span, span, (20, robot.n_joints))
    mine = forward(robot.table, q, robot.is_revolute, robot.base_T_first).base_T_frame[:, -1]
    return float(np.linalg.norm(mine[:, :3, 3] - chain_frames(chain, q)[:, -1, :3, 3], axis=1).max())


def _with_source(robot: Robot, chain: SerialChain, path: Path) -> RobotFile:
    for name in (robot.name, chain.base, chain.tip, *(joint.name for joint in robot.joints)):
        if name and not is_one_line(name):
            raise RobotFileError(f"{path}: holds the name {name[:60]!r}; a name has no hidden characters, rename it")
    source = {"file": path.name} | {key: name for key, name in (("base", chain.base), ("tip", chain.tip)) if name}
    robot = replace(robot, extra={SOURCE: source})
    refuse_beyond(robot, path)
    return RobotFile(robot, chain, chain.notes)


def _refuse_unused(path: Path, suffix: str, reading: ReadOptions) -> None:
    """Raise RobotFileError for an option that the file's format does not use."""
    has_links = suffix in (".urdf", ".xml", ".xacro")
    for option, value, used in (
        ("--tip", reading.tip, has_links),
        ("--base", reading.base, has_links),
        ("--convention", reading.convention, suffix == ".csv"),
        ("--model", reading.model, suffix == ".conf"),
    ):
        if value is not None and not used:
            raise RobotFileError(f"{path}: {option} says nothing about a {suffix}; leave it out")
