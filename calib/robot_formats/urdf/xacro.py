"""xacro: macros of a URDF, expanded by xacrodoc (the extra `xacro`) in a process of its own.

A xacro is a program: it names other files and computes. Its expressions are arithmetic on plain data, never Python. It
is expanded only where the caller says so (`Xacro`), for a file that the user named; it reads below its own folder and
those of the packages that are named, no environment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from calib.bounded_process import ProcessFailed, ProcessLimits, ask
from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.urdf.safe_xml import Element, XmlFile, parse_xml, read_bytes

_MOST_SECONDS = 30
_INSTALL = "pip install 'robot-calibration-inspector[xacro]'"


@dataclass(frozen=True)
class Xacro:
    """Leave to expand xacro files, and with what."""

    args: Mapping[str, str] = field(default_factory=dict)  # of <xacro:arg>
    packages: Mapping[str, Path] = field(default_factory=dict)  # what $(find NAME) is


def expanded_xacro(path: Path, given: Xacro) -> XmlFile:
    """The URDF that a xacro makes; its elements keep the files and lines that they were written in.

    Raises RobotFileError in one line with file and line: xacrodoc is not there, other files than it may read, mistakes.
    """
    read_bytes(path)
    if any(find_spec(name) is None for name in ("xacrodoc", "xacro")):
        raise RobotFileError(
            f"{path}: line 1: a xacro needs the extra `xacro` to be expanded: {_INSTALL}; or run "
            "`xacro FILE.xacro > FILE.urdf` where ROS is and give FILE.urdf"
        )
    for name, folder in given.packages.items():
        if not folder.is_dir():
            raise RobotFileError(f"--xacro-package {name}={folder}: is no folder; name that of the package")
    whole, packages = path.resolve(), {name: str(folder.resolve()) for name, folder in given.packages.items()}
    request = {
        "file": str(whole),
        "args": dict(given.args),
        "packages": packages,
        "folders": [str(whole.parent), *packages.values()],
    }
    try:
        answer = ask("calib.robot_formats.urdf.xacro_process:answer", request, ProcessLimits(seconds=_MOST_SECONDS))
    except ProcessFailed as error:
        raise RobotFileError(f"{path}: the xacro {error}; look for macros that repeat without end") from None
    if "error" in answer:
        shown = _shown(answer.get("file"), path)
        of = "" if shown == path else f" of {shown}"
        raise RobotFileError(f"{path}: line {answer.get('line') or 1}{of}: {answer['error']}")
    file = parse_xml(path, answer["text"].encode())
    places = iter(answer["places"])
    return replace(file, root=_with_places(file.root, places, path))


def _with_places(root: Element, places: Any, path: Path) -> Element:
    """The elements with the files and lines of the xacro, which stand in the order of the text."""
    place = next(places, None)
    file, line = (path, root.line) if place is None else (_shown(place[0], path), int(place[1]))
    return replace(
        root,
        line=line,
        file=None if file == path else file,
        children=[_with_places(child, places, path) for child in root.children],
    )


def _shown(file: str | None, path: Path) -> Path:
    """A file as the user would name it: relative to where the xacro was named from."""
    if file is None or Path(file).resolve() == path.resolve():
        return path
    whole = Path(file).resolve()
    folder = path.resolve().parent
    return path.parent / whole.relative_to(folder) if whole.is_relative_to(folder) else whole
