"""Robots written as xacro, expanded by the libraries `xacrodoc` and `xacro` (the extra `xacro`), without ROS.

A xacro is a program, which runs as the user does: only a file that the command line names is expanded.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.robot_file import ReadOptions, RobotFile, of_urdf
from calib.robot_formats.urdf.safe_xml import parse_xml, read_bytes

_INSTALL = "pip install 'robot-calibration-inspector[xacro]'"
_PACKAGE = "package.xml"
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_FIND, _ARG = re.compile(r"\$\(find\s+([\w.-]+)\s*\)"), re.compile(r"\$\(arg\s+([\w.-]+)\s*\)")
_INCLUDE = re.compile(r"<xacro:include\s[^>]*filename=[\"']([^\"']+)[\"']")
_DEFAULT = re.compile(r"<xacro:arg\s+(?=[^>]*\bdefault\s*=)[^>]*\bname=[\"']([^\"']+)[\"']")


def read_xacro(path: Path, reading: ReadOptions) -> RobotFile:
    """Robot of a xacro, expanded with the arguments and packages of the options. Raises RobotFileError in one line."""
    if reading.xacro_args is None:
        urdf = path.with_suffix("").with_suffix(".urdf").name
        raise RobotFileError(
            f"{path}: a xacro is a program, which the command line alone runs: `inspector convert {path.name} {urdf}`, "
            f"and give {urdf}"
        )
    packages = dict(reading.packages or {})
    for name, folder in packages.items():
        if not folder.is_dir():
            raise RobotFileError(f"--package {name}={folder}: is no folder; name that of the package")
    text = _expanded(path, reading.xacro_args, packages)
    file = parse_xml(path.with_name(f"{path.name} (expanded)"), text.encode())
    return of_urdf(file, path, replace(reading, packages=packages))


def _folder(path: Path, packages: dict[str, Path], name: str) -> Path | None:
    """Folder of a package: given, with a package.xml above the file, or beside the file or such a folder.

    What is found joins the packages that are known.
    """
    if name not in packages:
        above = [folder for folder in path.resolve().parents if (folder / _PACKAGE).is_file()]
        named = [folder for folder in above if name in (folder.name, _name_in(folder / _PACKAGE))]
        beside = [folder.parent / name for folder in above] + [path.resolve().parent / name]
        found = next((folder for folder in (*named, *beside) if folder.is_dir()), None)
        if found is not None:
            packages[name] = found
    return packages.get(name)


def _name_in(path: Path) -> str:
    """Name of a package in its package.xml; the parser keeps no text, so it is looked for between the tags."""
    _, _, behind = read_bytes(path).decode("utf-8", "replace").partition("<name>")
    return behind.partition("</name>")[0].strip()


def _lacking(path: Path, arguments: Mapping[str, str], packages: dict[str, Path]) -> list[str]:
    """Options for all packages that are not found and arguments without a value, of a xacro and what it includes."""
    waiting, seen, finds, uses, given = [path], set[Path](), dict[str, None](), dict[str, None](), set(arguments)
    while waiting:
        at = waiting.pop(0).resolve()
        if at in seen or not at.is_file():
            continue
        seen.add(at)
        text = _COMMENT.sub("", read_bytes(at).decode("utf-8", "replace"))
        finds |= dict.fromkeys(_FIND.findall(text))
        uses |= dict.fromkeys(_ARG.findall(text))
        given |= set(_DEFAULT.findall(text))
        for name in _INCLUDE.findall(text):
            waiting.append(at.parent / _FIND.sub(lambda one: str(_folder(path, packages, one[1])), name))
    missing = [f"--package {name}=FOLDER" for name in finds if _folder(path, packages, name) is None]
    return missing + [f"--xacro-arg {name}:=VALUE" for name in uses if name not in given]


def _expanded(path: Path, arguments: Mapping[str, str], packages: dict[str, Path]) -> str:
    """Text of the URDF that a xacro makes; whatever the libraries raise becomes one line. Raises RobotFileError."""
    read_bytes(path)
    if any(find_spec(name) is None for name in ("xacrodoc", "xacro")):
        raise RobotFileError(
            f"{path}: a xacro needs the extra `xacro` to be expanded: {_INSTALL}; or run `xacro FILE.xacro > "
            "FILE.urdf` where ROS is and give FILE.urdf"
        )
    import xacro
    import xacrodoc

    def get_path(name: str) -> str:
        folder = _folder(path, packages, name)
        if folder is None:
            raise RobotFileError(f"$(find {name}) is not known")
        return str(folder.resolve())

    xacrodoc.packages.get_path = get_path  # its own would ask ROS, and keep what it found for the next file
    xacro.init_stacks(str(path))
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):  # its warnings are not ours
            made = xacrodoc.XacroDoc.from_file(
                str(path), walk_up=False, subargs=dict(arguments), resolve_packages=False
            )
            return str(made.dom.toxml())
    except Exception as error:
        if lacking := _lacking(path, arguments, packages):
            raise RobotFileError(f"{path}: xacro: more is needed to expand it: give {' '.join(lacking)}") from None
        words = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, RecursionError):
            words = "macros or properties go round in a circle"
        innermost = Path((xacro.filestack or [path])[-1] or path)
        of = "" if innermost.name == path.name else f"in {innermost.name}: "
        raise RobotFileError(f"{path}: xacro: {of}{words[:300]}") from None
