"""Conversion of a command's options to the options for reading a robot's file (`ReadOptions`)."""

from __future__ import annotations

from calib.robot_formats.robot_file import ReadOptions
from calib.robot_formats.urdf.xacro import Xacro
from inspector.cli.options.shared import RobotFileOptions


def reading_of(options: RobotFileOptions, *, named: bool = True) -> ReadOptions:
    """Options for `read_robot`; a xacro is expanded only where the user `named` the file."""
    xacro = Xacro(dict(options.xacro_arg), dict(options.package)) if named else None
    packages = dict(options.package) if named else None
    return ReadOptions(
        options.tip,
        options.base,
        options.convention,
        options.model,
        xacro,
        packages,
    )
