"""The command `convert`: a robot from one file form into another."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calib.dataset.files.atomic_write import write_bytes_atomically
from calib.dataset.files.robot_toml import robot_to_toml
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.robot_formats.calibrated_file import calibrated_urdf, calibrated_yaml
from calib.robot_formats.chain.five_parameters import chain_of
from calib.robot_formats.origin_yaml import plain_yaml
from calib.robot_formats.robot_file import RobotFile, conversion_error_mm, read_robot
from calib.robot_formats.urdf.text import plain_urdf
from inspector.cli.dataset_commands import show
from inspector.cli.options import ConvertOptions
from inspector.cli.robots.reading import reading_of

_OUTPUTS = (".toml", ".urdf", ".yaml", ".yml")


def run_convert(options: ConvertOptions) -> int:
    """Read a robot and write it in another form."""
    _check_out(options)
    found = read_robot(options.source, reading_of(options))
    content, said = _content(options, found)
    write_bytes_atomically(options.out, content)
    text = "\n".join([f"{options.out}: {found.summary}", *said])
    show(options, _document(options, found, said), text)
    return 0


def _content(options: ConvertOptions, found: RobotFile) -> tuple[bytes, list[str]]:
    """Content of the output file, and remarks on it."""
    if options.out.suffix.lower() == ".toml":
        return robot_to_toml(found.robot).encode(), []
    is_urdf = options.out.suffix.lower() == ".urdf"
    if options.template is not None:
        make = calibrated_urdf if is_urdf else calibrated_yaml
        written = make(options.template, found.robot)
        return written.content, [written.summary]
    chain = chain_of(found.robot)
    if not is_urdf:
        return plain_yaml(chain).encode(), [
            "note: a maker's description has other frames; give its own file as --template"
        ]
    return plain_urdf(chain).encode(), [f"note: {note}" for note in _not_in_urdf(found.robot)]


def _not_in_urdf(robot: Robot) -> list[str]:
    """What a plain URDF cannot hold of a robot."""
    notes = []
    x, y, z = robot.gravity_m_s2
    if x or y or z > 0.0:
        notes.append("the base does not stand upright: it hangs on a link world, whose z axis points up")
    if any(target is not robot.own_tool_point for target in robot.targets):
        notes.append("further targets are left out")
    if any(joint.mass_kg for joint in robot.joints):
        notes.append("the inertias in it are placeholders, as robot.toml has masses only")
    return notes


def _check_out(options: ConvertOptions) -> None:
    """Raise CalibError for an output place or form that cannot be written, before anything is read."""
    out: Path = options.out
    if out.suffix.lower() not in _OUTPUTS:
        raise CalibError(f"{out}: expected a name that ends in {' or '.join(_OUTPUTS)}")
    for path in (options.source, options.template):
        if path is not None and path.resolve() == out.resolve():
            raise CalibError(f"{out}: is what this command reads, which would be lost; name another file to write")
    if out.exists() and not options.force:
        raise CalibError(f"{out}: exists; name another file, or --force to replace it")
    if options.template is not None and options.template.suffix.lower() != out.suffix.lower():
        raise CalibError(
            f"--template {options.template}: is of another form than {out}; only a .urdf or .yaml is made of one"
        )


def _document(options: ConvertOptions, found: RobotFile, said: list[str]) -> dict[str, Any]:
    robot, chain = found.robot, found.chain
    return {
        "out": str(options.out),
        "robot": robot.name,
        "joints": [joint.name for joint in robot.joints],
        "base": None if chain is None else chain.base or None,
        "tip": None if chain is None else chain.tip or None,
        "largest_difference_mm": None if chain is None else conversion_error_mm(robot, chain),
        "notes": [*found.notes, *said],
    }
