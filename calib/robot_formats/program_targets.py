"""Existing robot programs: their targets read, and new numbers written in their place, all other bytes as they were."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.robot_formats.program_text import krl, rapid, urscript
from calib.robot_formats.program_text.pose_numbers import FORM, NUMBERS, least_decimals, pose_transform
from calib.robot_formats.program_text.source import LeftLiteral, NamedFrame, ProgramTarget, ProgramTargets, Source

LANGUAGES = {".script": "URScript", ".src": "KRL", ".dat": "KRL", ".mod": "RAPID", ".prg": "RAPID"}
"""Languages by the suffix of a program's file."""
_LARGEST_BYTES = 10_000_000
_READERS: dict[str, tuple[Callable[[Source], ProgramTargets], object]] = {
    "URScript": (urscript.urscript_targets, urscript.MASKED),
    "KRL": (krl.krl_targets, krl.MASKED),
    "RAPID": (rapid.rapid_targets, rapid.MASKED),
}


@dataclass(frozen=True)
class Program:
    """A robot program with the targets that were found in it."""

    path: Path
    language: str
    content: bytes
    targets: tuple[ProgramTarget, ...]
    left: tuple[LeftLiteral, ...]
    notes: tuple[str, ...] = ()

    def with_values(self, values: Mapping[int, Array]) -> bytes:
        """Content with new numbers of some targets, by their index, in the program's own units.

        A number that stays the same to its decimals keeps its text.
        """
        parts: list[bytes] = []
        end = 0
        changed = {target.place: (target, values[k]) for k, target in enumerate(self.targets) if k in values}
        for place in sorted(changed):
            target, new = changed[place]
            least = least_decimals(self.language, target.kind, len(target.numbers))
            for number, value, decimals in zip(target.numbers, new, least, strict=True):
                text = number.written(float(value), decimals)
                parts.append(self.content[end : number.start])
                same = float(text) == number.value
                parts.append(self.content[number.start : number.end] if same else text.encode("ascii"))
                end = number.end
        return b"".join([*parts, self.content[end:]])


def load_program(path: Path) -> Program:
    """Program read from a .script, .src, .dat, .mod or .prg file. Raises CalibError."""
    language = language_of(path)
    if not path.exists():
        raise CalibError(f"{path}: no such file; name a robot program")
    if not path.is_file():
        raise CalibError(f"{path}: is no file; name a robot program")
    size = path.stat().st_size
    if size > _LARGEST_BYTES:
        raise CalibError(
            f"{path}: the file has {size / 1e6:.4g} MB; a program has at most {_LARGEST_BYTES / 1e6:g} MB, so correct "
            "the module that has the targets"
        )
    content = path.read_bytes()
    if b"\0" in content:
        raise CalibError(f"{path}: byte {content.index(0)} is zero; a {language} program is text of one byte a letter")
    read, masked = _READERS[language]
    found = read(Source(str(path), content.decode("latin-1"), masked))  # type: ignore[arg-type]
    if not found.targets:
        first = next(iter(found.left), None)
        seen = (
            f"; {len(found.left)} left, the first in line {first.line}: {first.what}: {first.reason}" if first else ""
        )
        raise CalibError(f"{path}: no target in plain numbers was found in this {language} program{seen}")
    return Program(path, language, content, found.targets, found.left, found.notes)


def language_of(path: Path) -> str:
    """Language of a program by its suffix. Raises CalibError for an unknown one."""
    language = LANGUAGES.get(path.suffix.lower())
    if language is None:
        known = ", ".join(f"{suffix} ({name})" for suffix, name in LANGUAGES.items())
        raise CalibError(f"{path}: its suffix is that of no robot program; known are {known}")
    return language


def frame_given(language: str, option: str, text: str | None) -> Array | None:
    """Transform (4, 4), mm, of a frame that a user gives in the maker's own numbers. Raises CalibError."""
    if text is None:
        return None
    wrong = CalibError(f"{option} {text}: for {language} a frame is {NUMBERS[language]} numbers {FORM[language]}")
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        raise wrong from None
    if len(values) != NUMBERS[language] or not np.isfinite(values).all():
        raise wrong
    try:
        return pose_transform(language, values)
    except ValueError as error:
        raise CalibError(f"{option} {text}: {error}") from None


def require_frames(program: Program, tool: Array | None, work: Array | None) -> None:
    """Raise CalibError where a target's tool or work frame is neither in the program nor given, or not alone."""
    for option, given, frames in (
        ("--tool-frame", tool, [(target, target.tool) for target in program.targets]),
        ("--work-frame", work, [(target, target.work) for target in program.targets]),
    ):
        open_: dict[str, ProgramTarget] = {}
        for target, frame in frames:
            if frame is not None and frame.transform is None:
                open_.setdefault(frame.name, target)
        if not open_ and given is not None:
            raise CalibError(f"{program.path}: no target needs {option}: the program defines its own; leave it out")
        if open_ and given is None:
            name, target = next(iter(open_.items()))
            form, _, units = FORM[program.language].partition(" ")
            raise CalibError(
                f"{program.path}: line {target.line}: {target.name} needs {name}, which this file does not define; "
                f"give it as {option}={form} ({units})"
            )
        if len(open_) > 1:
            raise CalibError(
                f"{program.path}: {option} is one frame, and the file leaves {len(open_)} open: {', '.join(open_)}; "
                "correct a file for each"
            )


def frame_of(frame: NamedFrame | None, given: Array | None) -> Array:
    """Transform of a target's frame, the program's own or the given one."""
    known = None if frame is None else frame.transform
    found = known if known is not None else given
    assert found is not None  # by require_frames
    return found
