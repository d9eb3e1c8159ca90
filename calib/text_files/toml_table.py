"""TOML tables whose every error names the file, the key and a remedy."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import Any

from calib.errors import DatasetError, is_one_line
from calib.text_files.text_file import read_text

MOST_BYTES = 2_000_000  # parsed, it takes some hundred times as much
LARGEST_INTEGER = 2**63  # beyond it TOML promises nothing
REMEDY = "write numbers of usual size"
MOST_PARTS = 20  # of a dotted key: a parser's memory grows with their square
MOST_DEPTH = 30  # of lists and tables in each other
_TOKEN = re.compile(  # strings, comments, and what ends or nests keys; all else between is passed over
    r"""(?P<text>"{3}(?:[^"\\]++|\\.|"{1,2}(?!"))*+"{3,5}|'{3}(?:[^']++|'{1,2}(?!'))*+'{3,5}"""
    r"""|"(?:[^"\\\n]++|\\.)*+"|'[^'\n]*+'|\#[^\n]*+)"""
    r"""|(?P<unended>["'])|(?P<opens>[\[{])|(?P<closes>[\]}])|(?P<dot>\.)|(?P<ends>[=,\n])""",
    re.DOTALL,
)


class TomlTable:
    """One table of a TOML file, with its place in the file and a record of the keys that were read."""

    def __init__(self, data: Mapping[str, Any], file: Path, place: str = "") -> None:
        self.data = data
        self.file = file
        self.place = place
        self._read: set[str] = set()

    @classmethod
    def load(cls, path: Path) -> TomlTable:
        """Read a TOML file as its top-level table. Raises DatasetError."""
        missing = f"a dataset folder needs {path.name}"
        text = read_text(path, missing=missing, kind="TOML", most_bytes=MOST_BYTES)
        _refuse_nested(path, text)
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise DatasetError(f"{path}: not valid TOML: {error}") from None
        except ValueError:  # an integer of more digits than Python reads
            raise DatasetError(f"{path}: holds an integer of thousands of digits; {REMEDY}") from None
        for key, value in data.items():
            _require_usual_integers(path, key, value)
        return cls(data, path)

    def error(self, key: str, found: str, remedy: str) -> DatasetError:
        place = f"{self.place}.{key}" if self.place else key
        return DatasetError(f"{self.file}: {place}: {found}; {remedy}")

    def _get(self, key: str) -> Any:
        self._read.add(key)
        return self.data.get(key)

    def number(self, key: str, default: float | None = None, *, positive: bool = False) -> float | None:
        """Finite number under a key; `default` where the key is absent. Raises DatasetError."""
        value = self._get(key)
        if value is None:
            return default
        if not is_finite(value):
            raise self.error(key, f"found {value!r}", "a finite number is needed")
        if positive and value <= 0:
            raise self.error(key, f"found {value}", "a number above 0 is needed")
        return float(value)

    def required_number(self, key: str) -> float:
        value = self.number(key)
        if value is None:
            raise self.error(key, "the key is missing", f"add a line such as {key} = 0.0")
        return value

    def text(
        self, key: str, default: str | None = None, *, choices: Iterable[str] = (), lines: bool = False
    ) -> str | None:
        """Text under a key, of one line unless `lines`; `default` where the key is absent. Raises DatasetError."""
        value = self._get(key)
        if value is None:
            return default
        if not isinstance(value, str):
            raise self.error(key, f"found {value!r}", "a text in quotes is needed")
        if not all(map(is_one_line, re.split(r"[\r\n\t]", value) if lines else [value])):
            needed = "a text" if lines else "a text of one line"
            raise self.error(key, f"found {value!r}", f"{needed} without control characters is needed")
        allowed = tuple(choices)
        if allowed and value not in allowed:
            raise self.error(key, f"found {value!r}", "expected " + " or ".join(repr(c) for c in allowed))
        return value

    def date(self, key: str) -> str | None:
        """TOML date (2026-03-14 without quotes) under a key, as text; None where the key holds something else."""
        value = self._get(key)
        return value.isoformat() if isinstance(value, date) else None  # a time with a date is one too

    def required_text(self, key: str) -> str:
        value = self.text(key)
        if not value:
            raise self.error(key, "the key is missing or empty", f'add a line such as {key} = "..."')
        return value

    def flag(self, key: str, default: bool) -> bool:
        value = self._get(key)
        if value is None:
            return default
        if not isinstance(value, bool):
            raise self.error(key, f"found {value!r}", "true or false is needed")
        return value

    def vector(self, key: str) -> tuple[float, float, float] | None:
        """Three finite numbers under a key; None where the key is absent. Raises DatasetError."""
        value = self._get(key)
        if value is None:
            return None
        if not isinstance(value, list) or len(value) != 3 or not all(map(is_finite, value)):
            raise self.error(key, f"found {value!r}", "three finite numbers in [ ] are needed")
        return (float(value[0]), float(value[1]), float(value[2]))

    def record(self, kind: type, *, positive: bool = False, but: Collection[str] = ()) -> dict[str, Any]:
        """Values of a record's fields of the types number, vector, text and flag that the table has; angles become rad.

        Raises DatasetError, with `positive` for numbers that are not above 0.
        """
        out: dict[str, Any] = {}
        for each in fields(kind):
            key = f"{each.name.removesuffix('_rad')}_deg" if each.name.endswith("_rad") else each.name
            if each.name in but or key not in self.data:
                continue
            match str(each.type).partition(" ")[0]:
                case "float":
                    value = self.number(key, positive=positive)
                    out[each.name] = math.radians(value or 0.0) if key != each.name else value
                case "Vector":
                    out[each.name] = self.vector(key)
                case "str":
                    out[each.name] = self.text(key)
                case "bool":
                    out[each.name] = self.flag(key, False)
        return out

    def square_matrix(self, key: str, size: int) -> tuple[tuple[float, ...], ...]:
        """Matrix (size, size) of finite numbers under a key; () where the key is absent. Raises DatasetError."""
        rows = self._get(key)
        if rows is None:
            return ()
        is_square = isinstance(rows, list) and len(rows) == size
        if (
            not is_square
            or not all(isinstance(row, list) and len(row) == size for row in rows)
            or not all(is_finite(value) for row in rows for value in row)
        ):
            raise self.error(key, f"found {rows!r}", f"{size} rows of {size} finite numbers are needed")
        return tuple(tuple(map(float, row)) for row in rows)

    def table(self, key: str) -> TomlTable:
        """The sub-table under a key; empty where it is absent. Raises DatasetError."""
        value = self._get(key)
        place = f"{self.place}.[{key}]" if self.place else f"[{key}]"
        if value is not None and not isinstance(value, dict):
            raise self.error(key, f"found {value!r}", f"a table headed [{key}] is needed")
        return TomlTable(value or {}, self.file, place)

    def tables(self, key: str) -> list[TomlTable]:
        """The array of tables under a key; empty where it is absent. Raises DatasetError."""
        value = self._get(key)
        if value is None:
            return []
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise self.error(key, "found no array of tables", f"write each one under [[{key}]]")
        return [TomlTable(item, self.file, f"[[{key}]] {i + 1}") for i, item in enumerate(value)]

    def unread(self) -> dict[str, Any]:
        """The keys that were not read, with their values, so that writing the file again loses nothing."""
        return {key: value for key, value in self.data.items() if key not in self._read}


def is_finite(value: object) -> bool:
    """Whether a value of TOML is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def degrees(angle_rad: float) -> float:
    """An angle converted to degrees, rounded to 15 digits, so that 90.012 is written as 90.012."""
    return float(f"{math.degrees(angle_rad):.15g}")


def document_of(record: Any, *, but: Collection[str] = ()) -> dict[str, Any]:
    """Fields of a record as a table of TOML, then its `extra`: angles in degrees, lists for tuples, None left out."""
    out: dict[str, Any] = {}
    for name, value in ((each.name, getattr(record, each.name)) for each in fields(record)):
        if name in but or name == "extra" or value is None:
            continue
        if name.endswith("_rad"):
            name = f"{name.removesuffix('_rad')}_deg"
            value = list(map(degrees, value)) if isinstance(value, tuple) else degrees(value)
        out[name] = list(value) if isinstance(value, tuple) else value
    return out | dict(getattr(record, "extra", {}))


def _refuse_nested(file: Path, text: str) -> None:
    """Raise DatasetError, with the line, for dotted keys of many parts and for deeply nested tables and lists.

    Done before parsing, by the tokens alone: strings and comments are passed over. A string without an end stops the
    check, as it stops the parser.
    """
    depth = parts = 0
    for found in _TOKEN.finditer(text):
        match found.lastgroup:
            case "unended":
                return
            case "opens":
                depth, parts = depth + 1, 0
            case "closes":
                depth, parts = max(depth - 1, 0), 0
            case "ends":
                parts = 0
            case "dot":
                parts += 1
        if parts >= MOST_PARTS or depth > MOST_DEPTH:
            what = f"a key of more than {MOST_PARTS} parts" if parts >= MOST_PARTS else "nested too deep"
            line = text.count("\n", 0, found.start()) + 1
            raise DatasetError(f"{file}: line {line}: {what}; a dataset's tables are two deep")


def _require_usual_integers(file: Path, place: str, value: object) -> None:
    """Raise DatasetError, with the place, where a value holds an integer too large for a measurement."""
    if isinstance(value, dict):
        for key, inside in value.items():
            _require_usual_integers(file, f"{place}.{key}", inside)
    elif isinstance(value, list):
        for k, inside in enumerate(value):
            _require_usual_integers(file, f"{place}[{k}]", inside)
    elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        digits = round(abs(value).bit_length() * math.log10(2.0))
        raise DatasetError(f"{file}: {place}: found an integer of about {digits} digits; {REMEDY}")
