"""JSON from a file that someone else may have written: every value is checked, an error is one line with its place."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from calib.errors import CalibError

SIZE_LIMIT = 10_000_000  # bytes; a long session is some 100 kB
TEXT_LIMIT = 2_000
LIST_LIMIT = 1_000


class SessionFileError(CalibError):
    """A session file cannot be used."""


def read_object(path: Path) -> Reader:
    """The file's object. Raises SessionFileError."""
    return Reader(path, "").mapping(_json(path))


def _json(path: Path) -> Any:
    def constant(name: str) -> NoReturn:
        raise SessionFileError(f"{path}: found {name}; a session file holds finite numbers only")

    try:
        if path.stat().st_size > SIZE_LIMIT:
            raise SessionFileError(
                f"{path}: larger than {SIZE_LIMIT // 1_000_000} MB, this is no session file"
            )
        return json.loads(path.read_text(encoding="utf-8"), parse_constant=constant)
    except FileNotFoundError:
        raise SessionFileError(f"{path}: no such session file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise SessionFileError(f"{path}: cannot be read as text ({error})") from None
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise SessionFileError(
            f"{path}: {where}: not valid JSON ({error.msg}); save the session again"
        ) from None
    except (RecursionError, ValueError) as error:  # nested a thousand deep, a number of a thousand digits
        raise SessionFileError(f"{path}: not a session file ({type(error).__name__})") from None


class Reader:
    """One object of the file, that knows where it stands."""

    def __init__(self, path: Path, place: str, data: Mapping[str, Any] | None = None) -> None:
        self._path, self._place, self._data = path, place, data or {}

    def fail(self, key: str, found: str, remedy: str) -> NoReturn:
        """Raise, naming file and place."""
        place = ".".join(part for part in (self._place, key) if part)
        raise SessionFileError(f"{self._path}: {place}: found {found}; {remedy}")

    def value(self, key: str) -> Any:
        """Whatever stands there."""
        return self._data.get(key)

    def mapping(self, value: Any, key: str = "") -> Reader:
        """A value that has to be an object."""
        place = ".".join(part for part in (self._place, key) if part)
        if not isinstance(value, dict):
            self.fail(key or "the file", _kind(value), "an object { } is needed")
        return Reader(self._path, place, value)

    def mapping_at(self, key: str) -> Reader:
        """An object."""
        return self.mapping(self._data.get(key), key)

    def _list(self, key: str) -> list[Any]:
        value = self._data.get(key)
        if not isinstance(value, list):
            self.fail(key, _kind(value), "a list [ ] is needed")
        if len(value) > LIST_LIMIT:
            self.fail(key, f"{len(value)} entries", f"{LIST_LIMIT} are the most")
        return value

    def mappings_at(self, key: str) -> list[Reader]:
        """A list of objects."""
        return [self.mapping(item, f"{key}[{i}]") for i, item in enumerate(self._list(key))]

    def texts_at(self, key: str) -> tuple[str, ...]:
        """A list of texts."""
        return tuple(self._text(f"{key}[{i}]", item) for i, item in enumerate(self._list(key)))

    def text(self, key: str) -> str:
        """A text that is not empty."""
        return self._text(key, self._data.get(key))

    def _text(self, key: str, value: Any) -> str:
        if not isinstance(value, str) or not value or len(value) > TEXT_LIMIT or "\0" in value:
            self.fail(key, _kind(value), "a text is needed")
        return value

    def optional_text(self, key: str) -> str | None:
        """A text, or None where there is none."""
        return None if self._data.get(key) is None else self.text(key)

    def texts(self) -> dict[str, str]:
        """All values, each a text."""
        return {key: self.text(key) for key in self._data}

    def flag(self, key: str) -> bool | None:
        """true, false, or None where there is none."""
        value = self._data.get(key)
        if value is not None and not isinstance(value, bool):
            self.fail(key, _kind(value), "true or false is needed")
        return value

    def number(self, key: str) -> float | None:
        """A finite number, or None where there is none."""
        value = self._data.get(key)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            self.fail(key, _kind(value), "a finite number is needed")
        return float(value)

    def size(self, key: str) -> float | None:
        """As `number`, above 0."""
        value = self.number(key)
        if value is not None and value <= 0.0:
            self.fail(key, f"{value:g}", "a number above 0 is needed")
        return value

    def sizes(self) -> dict[str, float]:
        """All values, each a number above 0."""
        out = {}
        for key in self._data:
            value = self.size(key)
            if value is None:
                self.fail(key, "null", "a number above 0 is needed")
            out[key] = value
        return out


def _kind(value: Any) -> str:
    """What stands there, short enough for a line."""
    if value is None:
        return "nothing"
    return f"{value!r:.60}".replace("\n", " ") + (" ..." if len(repr(value)) > 60 else "")
