"""Robots given by a user: read from a file of any form or a dataset, or built in; and written as a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.dataset.files.atomic_write import write_bytes_atomically
from calib.dataset.files.robot_toml import robot_to_toml
from calib.errors import CalibError
from calib.frames import rpy_from_rotation
from calib.kinematics.commanded import commands_in_words
from calib.kinematics.flange import flange_T_tip
from calib.kinematics.robot import FixedFrame, Robot
from calib.options import BUILTIN_ROBOTS
from calib.plugins import load
from calib.robot_formats.calibrated_file import in_template
from calib.robot_formats.chain.five_parameters import chain_of
from calib.robot_formats.origin_yaml import plain_yaml
from calib.robot_formats.robot_file import ReadOptions, named_robot
from calib.robot_formats.robot_form import forms_of, template_suffixes, written_suffixes
from calib.robot_formats.urdf.text import plain_urdf

RobotContent = tuple[bytes, tuple[str, ...]]  # of a robot's file, and notes on what it cannot hold


def load_robot(
    source: Robot | str | Path,
    *,
    tip: str | None = None,
    base: str | None = None,
    convention: str | None = None,
    model: str | None = None,
) -> Robot:
    """A robot from robot.toml, URDF, a kinematics YAML or CSV, a form of a plug-in, a dataset's folder, or by its name.

    Args:
        source: the file, the folder, the name of a built-in robot ("rb5", "panda"), or a robot, which is returned.
        tip: link, body or site at which the arm of a file with links ends, where it has several.
        base: link or body at which it starts.
        convention: "standard" or "modified", of a .csv table of theta, d, a, alpha.
        model: model of a UR arm, for a controller's calibration.conf.

    Raises:
        CalibError: names the file, the line or key, what was found, and what would do.

    >>> import calib
    >>> calib.load_robot("panda")
    Robot(Franka Panda: 7 joints RRRRRRR)
    >>> calib.load_robot("sample_data/ur10_ipa/robot.toml").n_joints
    6
    """
    if isinstance(source, Robot):
        return source
    if not isinstance(source, str | Path):
        raise CalibError(f"found a {type(source).__name__}, expected a Robot, the path of its file, or a name")
    name, path = str(source).lower(), Path(source)
    reading = ReadOptions(tip, base, convention, model)
    if path.is_dir():
        return named_robot(str(path / "robot.toml"), reading).robot
    if not path.exists() and not path.suffix:
        if name not in BUILTIN_ROBOTS:
            known = " or ".join(BUILTIN_ROBOTS)
            raise CalibError(f"{source}: no such file or folder; give a dataset's folder, a robot's file, or {known}")
        return named_robot(name, reading).robot
    return named_robot(str(path), reading).robot


def save_robot(robot: Robot | str | Path, path: str | Path, template: str | Path | None = None) -> tuple[str, ...]:
    """Write a robot as .toml, .urdf, .yaml or a form of a plug-in; returns notes on what the form cannot hold.

    Args:
        robot: a robot, or what `load_robot` takes: so one form is converted into another.
        path: the file to write; its suffix says which form.
        template: the user's own .urdf or .yaml of this arm, whose origins are replaced and all else stays.

    Raises:
        CalibError: another suffix, or a template that is of another arm.

    >>> import calib
    >>> notes = calib.save_robot("panda", "panda.urdf")
    >>> calib.load_robot("panda.urdf").n_joints
    7
    """
    content, notes = robot_content(load_robot(robot), Path(path), None if template is None else Path(template))
    write_bytes_atomically(Path(path), content)
    return notes


def require_written(path: Path, template: Path | None = None) -> None:
    """Raise CalibError for the name of a robot's file that is not written, or not made of such a template."""
    written = written_suffixes()
    suffix = path.suffix.lower()
    if suffix not in written:
        raise CalibError(f"{path}: expected a name that ends in {' or '.join(written)}")
    made = [each for each in template_suffixes() if each in written]
    if template is not None and (template.suffix.lower() != suffix or suffix not in made):
        raise CalibError(f"{template}: is of another form than {path}; only a {' or '.join(made)} is made of one")


def robot_content(robot: Robot, path: Path, template: Path | None = None) -> RobotContent:
    """The bytes of a robot's file of this name, and notes on what it cannot hold (see `save_robot`)."""
    require_written(path, template)
    if template is not None:
        made = in_template(template, robot)
        return made.content, tuple(made.summary.split("\n"))
    writer = next(form.writer for form in forms_of(path) if form.writer)
    return load(writer)(robot)


def toml_content(robot: Robot) -> RobotContent:
    """The bytes of robot.toml, which holds all of a robot."""
    return robot_to_toml(robot).encode(), ()


def urdf_content(robot: Robot) -> RobotContent:
    """The bytes of a plain URDF, and notes on what it cannot hold. Raises RobotFileError."""
    x, y, z = robot.gravity_m_s2
    leans = bool(x or y or z > 0.0)
    said = ["note: the base does not stand upright: it hangs on a link world, whose z axis points up"] if leans else []
    return plain_urdf(chain_of(robot)).encode(), (*said, *not_in_model(robot))


def yaml_content(robot: Robot) -> RobotContent:
    """The bytes of a kinematics YAML, with a note on its frames. Raises RobotFileError."""
    note = "note: a maker's description has other frames; give its own file as --template"
    tip = chain_of(robot).last_T_tip
    lost: tuple[str, ...] = ()
    if not np.allclose(tip, np.eye(4), atol=1e-6):
        numbers = [*tip[:3, 3], *np.degrees(rpy_from_rotation(tip[:3, :3]))]
        x, y, z, *rpy_deg = (f"{value + 0.0:.6g}" for value in np.round(numbers, 6))
        place = f"{x}, {y}, {z} mm and roll, pitch, yaw {', '.join(rpy_deg)} deg from the last joint"
        lost = (f"note: the tip, {place}, is lost; .toml keeps it",)
    return plain_yaml(chain_of(robot)).encode(), (note, *lost, *_own_joints(robot))


def _own_joints(robot: Robot) -> tuple[str, ...]:
    """Note on a convention of the user's joints, which only robot.toml holds."""
    told = commands_in_words(robot)
    return (f"note: its joints are the arm's own, and not those of your tables: {', '.join(told)}",) if told else ()


def not_in_model(robot: Robot) -> tuple[str, ...]:
    """Notes on properties of a robot that no description of links and joints holds."""
    notes = [*_own_joints(robot)]
    if any(target is not robot.own_tool_point for target in robot.targets):
        notes.append("note: further targets are left out")
    if any(joint.mass_kg for joint in robot.joints):
        notes.append("note: the inertias in it are placeholders, as robot.toml has masses only")
    if robot.flange != FixedFrame() and not np.allclose(flange_T_tip(robot), np.eye(4), atol=1e-6):
        notes.append("note: [flange] is left out; the link tool0 is the end of [tool]")
    return tuple(notes)
