"""Expansion of xacro files by xacrodoc (the extra `xacro`) in a separate bounded process.

A xacro is a program: it names other files and computes. Its expressions are evaluated as arithmetic on plain data,
never as Python. It is expanded only where the caller allows it (`Xacro`), for a file that the user named; it reads
below its own folder and those of the named packages, and no environment variables.
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
    """Permission to expand xacro files, with their arguments and package folders."""

    args: Mapping[str, str] = field(default_factory=dict)  # of <xacro:arg>
    packages: Mapping[str, Path] = field(default_factory=dict)  # what $(find NAME) is


def expanded_xacro(path: Path, given: Xacro) -> XmlFile:
    """Expanded URDF of a xacro; its elements keep the files and lines that they come from.

    Raises RobotFileError in one line with file and line: xacrodoc is not installed, forbidden files, mistakes.
    """
    read_bytes(path)
    if any(find_spec(name) is None for name in ("xacrodoc", "xacro")):
        raise RobotFileError(
            f"{path}: line 1: a xacro needs the extra `xacro` to be expanded: {_INSTALL}; or run "
            "`xacro FILE.xacro > FILE.urdf` where ROS is and give FILE.urdf"
        )
    for name, folder in given.packages.items():
        if not folder.is_dir():
            raise RobotFileError(f"--package {name}={folder}: is no folder; name that of the package")
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
        named = _as_named(answer.get("file"), path)
        of = "" if named == path else f" of {named}"
        raise RobotFileError(f"{path}: line {answer.get('line') or 1}{of}: {answer['error']}")
    file = parse_xml(path, answer["text"].encode())
    places = iter(answer["places"])
    return replace(file, root=_with_places(file.root, places, path))


def _with_places(root: Element, places: Any, path: Path) -> Element:
    """The elements with their files and lines in the xacro; `places` is in the order of the text."""
    place = next(places, None)
    file, line = (path, root.line) if place is None else (_as_named(place[0], path), int(place[1]))
    return replace(
        root,
        line=line,
        file=None if file == path else file,
        children=[_with_places(child, places, path) for child in root.children],
    )


def _as_named(file: str | None, path: Path) -> Path:
    """Path of a file as in the user's command, relative to the folder from which the xacro was named."""
    if file is None or Path(file).resolve() == path.resolve():
        return path
    whole = Path(file).resolve()
    folder = path.resolve().parent
    return path.parent / whole.relative_to(folder) if whole.is_relative_to(folder) else whole
