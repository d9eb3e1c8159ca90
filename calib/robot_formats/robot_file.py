"""Reading of a robot from a file of any supported format, by its suffix."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.dataset.files.robot_toml import builtin_robot, load_robot_toml, refuse_beyond
from calib.errors import is_one_line
from calib.frames import invert
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot
from calib.options import BUILTIN_ROBOTS
from calib.plugins import load
from calib.robot_formats.chain.five_parameters import frames_at_zero, robot_of
from calib.robot_formats.chain.serial_chain import RobotFileError, SerialChain, chain_frames
from calib.robot_formats.origin_yaml import chain_of_yaml, read_origin_yaml
from calib.robot_formats.robot_form import RobotForm, forms_of, known_suffixes
from calib.robot_formats.tables import chain_of_table
from calib.robot_formats.urdf.chain import ArmPath, before_jaw, chain_of_arm, find_arm, tip_links
from calib.robot_formats.urdf.meshes import MeshFile, Packages, link_meshes
from calib.robot_formats.urdf.safe_xml import XmlFile, parse_xml, read_bytes
from calib.robot_formats.urdf.tree import read_tree

SOURCE = "source"  # the table of robot.toml that says which file and links it was made of
_GONE = {  # forms that are not read, with what to give instead
    ".sdf": "SDF is not read; give the arm's URDF",
    ".srdf": "an SRDF is not read; give the arm's URDF, and the links of the group as --base and --tip",
}
_OF_EXTRA = (".xacro", ".conf")  # what calib/extras/robot_forms reads, where it is there


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
    """Options for what a robot's file does not define: tip, base, convention, model, a xacro's arguments."""

    tip: str | None = None  # link, body or site
    base: str | None = None
    convention: str | None = None  # of a table of theta, d, a, alpha: "standard" or "modified"
    model: str | None = None  # of a UR controller's calibration.conf
    xacro_args: Mapping[str, str] | None = None  # None: a xacro, which is a program, is not run
    packages: Packages | None = None  # folders of ROS packages with meshes; None: none is looked for


_FORM_OPTIONS = ("tip", "base", "convention", "model")  # which a form uses, or else refuses


def read_robot(path: str | Path, reading: ReadOptions = ReadOptions()) -> RobotFile:
    """Read the robot of a file, by its suffix.

    Raises CalibError in one line that names the file, the line or key, and a remedy.
    """
    path = Path(path)
    form = _form_of(path)
    for option in _FORM_OPTIONS:
        if getattr(reading, option) is not None and option not in form.options:
            raise RobotFileError(f"{path}: --{option} says nothing about a {path.suffix.lower()}; leave it out")
    return load(form.reader)(path, reading)


def _form_of(path: Path) -> RobotForm:
    """Form of a file, by its suffix and, where forms share that, by the root element. Raises RobotFileError."""
    suffix = path.suffix.lower()
    if suffix in _GONE:
        raise RobotFileError(f"{path}: {_GONE[suffix]}")
    forms = forms_of(path)
    if not forms and suffix in _OF_EXTRA:
        raise RobotFileError(f"{path}: {suffix} is read by the extra robot_forms, which this installation lacks")
    if not forms:
        if not path.exists():
            named = ", ".join(BUILTIN_ROBOTS)
            raise RobotFileError(f"{path}: no such file, and no built-in robot; there are {named}")
        found, known = suffix or "no suffix", ", ".join(known_suffixes())
        raise RobotFileError(f"{path}: {found} is no form of a robot; expected {known}")
    if len(forms) == 1:
        return forms[0]
    root = f"<{read_xml(path).root.tag}"
    return next((form for form in forms if form.mark == root), forms[0])


def read_toml(path: Path, reading: ReadOptions) -> RobotFile:
    """Robot of a robot.toml. Raises CalibError."""
    robot = load_robot_toml(path)
    refuse_beyond(robot, path)
    return RobotFile(robot, None)


def read_table(path: Path, reading: ReadOptions) -> RobotFile:
    """Robot of a table, by its columns. Raises CalibError."""
    return of_chain(chain_of_table(path, reading.convention), path)


def read_origins(path: Path, reading: ReadOptions) -> RobotFile:
    """Robot of a maker's YAML of joint origins. Raises CalibError."""
    return of_chain(chain_of_yaml(read_origin_yaml(path)), path)


def read_urdf(path: Path, reading: ReadOptions) -> RobotFile:
    """Robot of a URDF, with its meshes. Raises CalibError."""
    return of_urdf(read_xml(path), path, reading)


def of_urdf(file: XmlFile, path: Path, reading: ReadOptions) -> RobotFile:
    """Robot of a parsed URDF that came from a file, with its meshes in the frames of robot.toml. Raises CalibError."""
    arm = find_arm(read_tree(file), reading.tip, reading.base)
    chain = chain_of_arm(arm)
    read = of_chain(chain, path)
    found = link_meshes(arm, reading.packages)
    in_table = invert(frames_at_zero(read.robot)[1:-1]) @ chain.at_zero[:-1]
    meshes = tuple(
        tuple(replace(one, link_T_mesh=place @ one.link_T_mesh) for one in files)
        for place, files in zip(in_table, found.of_joint, strict=True)
    )
    return replace(read, notes=(*read.notes, *found.notes), meshes=meshes if any(meshes) else ())


def tips_of(path: Path) -> tuple[str, ...]:
    """Possible tip links of a file's arm, the tip of the longest arm first; () without a choice. Raises CalibError."""
    form = _form_of(path)
    return load(form.tips)(path) if form.tips else ()


def urdf_tips(path: Path) -> tuple[str, ...]:
    """Possible tip links of a URDF, the tip of the longest arm first. Raises CalibError."""
    tree = read_tree(read_xml(path))
    tips = tip_links(tree)
    return tuple(dict.fromkeys([*(before_jaw(tree, tip) for tip in tips[:1]), *tips]))


def named_robot(name: str, reading: ReadOptions = ReadOptions()) -> RobotFile:
    """Read a robot by the name of a built-in one or by its file. Raises CalibError."""
    if name in BUILTIN_ROBOTS:
        return RobotFile(builtin_robot(name), None)
    return read_robot(Path(name), reading)


def read_xml(path: Path) -> XmlFile:
    """Parsed XML file. Raises CalibError."""
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
    mine = nominal_chain(robot, q).base_T_frame[:, -1]
    return float(np.linalg.norm(mine[:, :3, 3] - chain_frames(chain, q)[:, -1, :3, 3], axis=1).max())


def of_chain(chain: SerialChain, path: Path, robot: Robot | None = None) -> RobotFile:
    """Robot of a file's chain, by default with the table made of it; it keeps the names of the file and its links.

    Raises RobotFileError for names with hidden characters and for numbers beyond any robot's.
    """
    robot = robot_of(chain) if robot is None else robot
    for name in (robot.name, chain.base, chain.tip, *(joint.name for joint in robot.joints)):
        if name and not is_one_line(name):
            raise RobotFileError(f"{path}: holds the name {name[:60]!r}; a name has no hidden characters, rename it")
    source = {"file": path.name} | {key: name for key, name in (("base", chain.base), ("tip", chain.tip)) if name}
    robot = replace(robot, extra={SOURCE: source})
    refuse_beyond(robot, path)
    return RobotFile(robot, chain, chain.notes)
