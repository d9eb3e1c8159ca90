"""Forms of a robot's file: what reads and writes each, found by the file's suffix; a plug-in brings further ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from calib.plugins import contributions

_FILE, _WRITTEN, _TEMPLATE = (
    f"calib.robot_formats.{module}" for module in ("robot_file", "robots", "calibrated_file")
)  # where the functions of core's own forms are


@dataclass(frozen=True)
class RobotForm:
    """A form of a robot's file; its functions are named as "module:name" and imported when they are used.

    Forms may share a suffix; then the beginning of the XML's root element, `mark`, tells whose a file is.
    """

    suffixes: tuple[str, ...]
    rank: int  # of several robots among a user's files that of the lowest rank is taken
    told_by: str  # what shows that a file is a robot in this form: "by its suffix .urdf"
    reader: str  # (path, ReadOptions) -> RobotFile
    mark: str = ""  # "<robot"; "" where the suffix is enough
    options: tuple[str, ...] = ()  # fields of ReadOptions that say something about such a file
    tips: str = ""  # (path) -> names of the links at which its arm may end; "" where there is no choice
    writer: str = ""  # (robot) -> bytes and notes; "" where it is not written
    in_template: str = ""  # (template, calibrated, nominal, comment) -> CalibratedFile; "" where there are no templates


_LINKS = ("tip", "base")
_CORE = (
    RobotForm((".toml",), 0, "a robot.toml", f"{_FILE}:read_toml", "[[joints]]", writer=f"{_WRITTEN}:toml_content"),
    RobotForm(
        (".urdf",), 1, "by its suffix .urdf", f"{_FILE}:read_urdf", options=_LINKS, tips=f"{_FILE}:urdf_tips",
        writer=f"{_WRITTEN}:urdf_content", in_template=f"{_TEMPLATE}:calibrated_urdf",
    ),
    RobotForm((".xml",), 3, "a URDF", f"{_FILE}:read_urdf", "<robot", _LINKS, f"{_FILE}:urdf_tips"),
    RobotForm(
        (".yaml", ".yml"), 6, "joint origins", f"{_FILE}:read_origins",
        writer=f"{_WRITTEN}:yaml_content", in_template=f"{_TEMPLATE}:calibrated_yaml",
    ),
    RobotForm((".json",), 7, "a table of theta, d, a, alpha", f"{_FILE}:read_table", options=("convention",)),
    RobotForm((".csv",), 5, "a table of the robot, by its columns", f"{_FILE}:read_table", options=("convention",)),
)  # fmt: skip


def robot_forms() -> tuple[RobotForm, ...]:
    """All forms: core's own, then those of plug-ins."""
    return (*_CORE, *contributions(RobotForm))


def forms_of(path: Path) -> tuple[RobotForm, ...]:
    """Forms that a file of this name may have, by its suffix; () where it is no robot's."""
    return tuple(form for form in robot_forms() if path.suffix.lower() in form.suffixes)


def rank_of(path: Path) -> int:
    """The lowest rank of the forms that a robot's file of this name may have."""
    return min(form.rank for form in forms_of(path))


def known_suffixes() -> tuple[str, ...]:
    """Suffixes of the files that are read."""
    return _suffixes(lambda form: True)


def written_suffixes() -> tuple[str, ...]:
    """Suffixes of the files that can be written."""
    return _suffixes(lambda form: bool(form.writer))


def template_suffixes() -> tuple[str, ...]:
    """Suffixes of the users' own files that can be written again with calibrated numbers."""
    return _suffixes(lambda form: bool(form.in_template))


def _suffixes(holds: Callable[[RobotForm], bool]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(suffix for form in robot_forms() if holds(form) for suffix in form.suffixes))
