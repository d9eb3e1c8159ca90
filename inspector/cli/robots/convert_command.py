"""The commands on a robot's file: `convert` into another form, and `where` its frames are at joint values."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calib.dataset.files.atomic_write import write_bytes_atomically
from calib.dataset_import.where import frames_told
from calib.errors import CalibError
from calib.present.where import frames_document, frames_text
from calib.robot_formats.robot_file import RobotFile, conversion_error_mm, read_robot
from calib.robot_formats.robots import require_written, robot_content
from inspector.cli.dataset_commands import show
from inspector.cli.options.datasets import ConvertOptions, WhereOptions


def run_convert(options: ConvertOptions) -> int:
    """Read a robot and write it in another file format."""
    _check_out(options)
    found = read_robot(options.source, options.reading())
    content, said = robot_content(found.robot, options.out, options.template)
    write_bytes_atomically(options.out, content)
    text = "\n".join([f"{options.out}: {found.summary}", *said])
    show(options, _document(options, found, said), text)
    return 0


def _check_out(options: ConvertOptions) -> None:
    """Raise CalibError, before anything is read, for an output path or format that cannot be written."""
    out: Path = options.out
    require_written(out, options.template)
    for path in (options.source, options.template):
        if path is not None and path.resolve() == out.resolve():
            raise CalibError(f"{out}: is what this command reads, which would be lost; name another file to write")
    if out.exists() and not options.force:
        raise CalibError(f"{out}: exists; name another file, or --force to replace it")


def _document(options: ConvertOptions, found: RobotFile, said: Sequence[str]) -> dict[str, Any]:
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


def run_where(options: WhereOptions) -> int:
    """Tell where frames are."""
    told = frames_told(options.robot, options.poses, options.joints, options.frame, options.reading())
    show(options, frames_document(told), frames_text(told))
    return 0
