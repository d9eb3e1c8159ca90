"""Existing robot programs: their targets read, and new numbers written in their place, all other bytes as they were."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.extras.robot_programs.program_text.krl import KrlReader
from calib.extras.robot_programs.program_text.pose_numbers import FORM, NUMBERS, least_decimals, pose_transform
from calib.extras.robot_programs.program_text.rapid import RapidReader
from calib.extras.robot_programs.program_text.reading import ProgramReader
from calib.extras.robot_programs.program_text.source import Source
from calib.extras.robot_programs.program_text.targets import NamedFrame, ProgramTarget, SkippedLiteral
from calib.extras.robot_programs.program_text.urscript import UrscriptReader

_READERS: dict[str, type[ProgramReader]] = {
    **dict.fromkeys((".script", ".urscript"), UrscriptReader),
    **dict.fromkeys((".src", ".dat"), KrlReader),
    **dict.fromkeys((".mod", ".prg", ".sys", ".modx", ".prgx", ".sysx"), RapidReader),
}
"""Readers by the suffix of a program's file."""
_LARGEST_BYTES = 10_000_000


@dataclass(frozen=True)
class Program:
    """A robot program with the targets that were found in it."""

    path: Path
    language: str
    content: bytes
    targets: tuple[ProgramTarget, ...]
    left: tuple[SkippedLiteral, ...]
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
                if text is not None:
                    parts += [self.content[end : number.start], text.encode("ascii")]
                    end = number.end
        return b"".join([*parts, self.content[end:]])


def load_program(path: Path, others: Sequence[Path] = ()) -> Program:
    """Program read from a URScript, KRL or RAPID file. Raises CalibError.

    Args:
        path: the program. The .dat beside a .src of the same name, and the .src beside a .dat, are read with it.
        others: more files of the same controller, which define frames and use the program's targets.
    """
    reader = _reader_of(path)
    language = reader.language
    content, more = _content(path, language), [*_siblings(path), *others]
    for other in others:
        if _reader_of(other) is not reader:
            found = _reader_of(other).language
            raise CalibError(f"{other}: is {found}, and {path} is {language}; name a file of its controller")
    texts = [(str(each), _content(each, language).decode("latin-1")) for each in more]
    targets, left, notes = reader(Source(reader.syntax, str(path), content.decode("latin-1"), texts)).targets()
    if not targets:
        seen = f"; {len(left)} left, the first in line {left[0].line}: {left[0].what}: {left[0].reason}" if left else ""
        raise CalibError(f"{path}: no target in plain numbers was found in this {language} program{seen}")
    return Program(path, language, content, targets, left, notes)


def _content(path: Path, language: str) -> bytes:
    """Bytes of a program's file. Raises CalibError for what is none."""
    if not path.is_file():
        raise CalibError(f"{path}: no such file; name a robot program")
    size = path.stat().st_size
    if size > _LARGEST_BYTES:
        raise CalibError(
            f"{path}: the file has {size / 1e6:.4g} MB; a program has at most {_LARGEST_BYTES / 1e6:g} MB, so correct "
            "the module that has the targets"
        )
    content = path.read_bytes()
    if b"\0" in content:
        raise CalibError(f"{path}: byte {content.index(0)} is zero; a {language} program is text of one byte a letter")
    return content


def _siblings(path: Path) -> list[Path]:
    """The other half of a KRL module: the file beside it that has its name."""
    other = {".src": ".dat", ".dat": ".src"}.get(path.suffix.lower())
    if other is None:
        return []
    beside = sorted(path.parent.glob("*"))
    return [each for each in beside if each.stem.lower() == path.stem.lower() and each.suffix.lower() == other][:1]


def _reader_of(path: Path) -> type[ProgramReader]:
    """Reader of a program by its suffix. Raises CalibError for an unknown one."""
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(f"{suffix} ({each.language})" for suffix, each in _READERS.items())
        raise CalibError(f"{path}: its suffix is that of no robot program; known are {known}")
    return reader


def frame_given(language: str, option: str, text: str | None) -> Array | None:
    """Transform (4, 4), mm, of a frame that a user gives in the maker's own numbers. Raises CalibError."""
    if text is None:
        return None
    try:
        values = np.array([float(part) for part in text.split(",")])
        if len(values) != NUMBERS[language] or not np.isfinite(values).all():
            raise ValueError(f"for {language} a frame is {NUMBERS[language]} numbers {FORM[language]}")
        return pose_transform(language, values)
    except ValueError as error:
        raise CalibError(f"{option} {text}: {error}; give it as {FORM[language]}") from None


def require_frames(program: Program, tool: Array | None, work: Array | None) -> None:
    """Raise CalibError where a target's tool or work frame is neither in the program nor given, or not alone."""
    form, _, units = FORM[program.language].partition(" ")
    for option, given, frames in (
        ("--tool-frame", tool, [(target.tool, target) for target in program.targets]),
        ("--work-frame", work, [(target.work, target) for target in program.targets]),
    ):
        open_ = {
            frame.name: target for frame, target in reversed(frames) if frame is not None and frame.transform is None
        }
        if given is not None and not open_:
            raise CalibError(f"{program.path}: no target needs {option}: the program defines its own; leave it out")
        if open_ and (given is None or len({name.lower() for name in open_}) > 1):
            name, target = min(open_.items(), key=lambda each: each[1].line)
            one = f"give it as {option}={form} ({units}), or " if len(open_) == 1 else f"of {', '.join(sorted(open_))} "
            raise CalibError(
                f"{program.path}: line {target.line}: {target.name} needs {name}, which this file does not define; "
                f"{one}name the file that defines it as --with FILE"
            )


def frame_of(frame: NamedFrame | None, given: Array | None) -> Array:
    """Transform of a target's frame, the program's own or the given one; of none the identity."""
    if frame is None:
        return np.eye(4)
    found = given if frame.transform is None else frame.transform
    return np.eye(4) if found is None else found
