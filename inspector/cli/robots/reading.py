"""Conversion of a command's options to the options for reading a robot's file (`ReadOptions`)."""

from __future__ import annotations

from calib.robot_formats.robot_file import ReadOptions
from inspector.cli.options.shared import RobotFileOptions


def reading_of(options: RobotFileOptions, *, named: bool = True) -> ReadOptions:
    """Options for `read_robot`; a xacro is run and meshes are looked for only where the user `named` the file."""
    xacro_args, packages = (dict(options.xacro_arg), dict(options.package)) if named else (None, None)
    return ReadOptions(options.tip, options.base, options.convention, options.model, xacro_args, packages)
