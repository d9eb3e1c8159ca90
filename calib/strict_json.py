"""Strict JSON: reading of untrusted files with every value checked, and writing of documents.

An error is one line that names the place in the file. Structs say what a file holds and msgspec checks it. Its errors
are put into our own words, since they name the type that is needed but not what was found, and among the values of a
mapping not the key. The text itself is read by json, which gives line and column of a mistake.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NoReturn, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from calib.errors import CalibError, visible

TEXT_LIMIT = 2_000
LIST_LIMIT = 1_000

Text = Annotated[str, Meta(min_length=1, max_length=TEXT_LIMIT, pattern=r"\A[^\0]*\Z")]
Texts = Annotated[tuple[Text, ...], Meta(max_length=LIST_LIMIT)]
Finite = Annotated[float, Meta(ge=-sys.float_info.max, le=sys.float_info.max)]
AboveZero = Annotated[float, Meta(gt=0.0, le=sys.float_info.max)]
MOST_SIZE = 1e15  # of an effect, in any unit: the square of more exceeds what double precision can add to other terms
Size = Annotated[float, Meta(gt=0.0, le=MOST_SIZE)]
SizeOrSign = Annotated[float, Meta(ge=-MOST_SIZE, le=MOST_SIZE)]

T = TypeVar("T")
Place = list[str | int]  # keys and indices from the outermost value inwards

OUT_OF_RANGE = "a finite number is needed"
OUT_OF_SIZE = f"a number of {MOST_SIZE:g} at most is needed"
_REMEDIES = (  # by what msgspec says that it expects
    ("`float` <= 1000000000000000.0", OUT_OF_SIZE),
    ("`float` >= -1000000000000000.0", OUT_OF_SIZE),
    ("`float` > 0", "a number above 0 is needed"),
    ("`float", OUT_OF_RANGE),
    ("`bool", "true or false is needed"),
    ("`str", "a text is needed"),
    ("`array", "a list [ ] is needed"),
    ("`object", "an object { } is needed"),
)


@dataclass(frozen=True)
class JsonFile:
    """A JSON file to be read: its path, its name in messages, and the error to raise."""

    path: Path
    kind: str  # "session file"
    remedy: str  # what to do about one that is no JSON
    error: type[CalibError]
    size_limit: int = 10_000_000  # bytes

    def read(self, kind: str, version: int) -> dict[str, Any]:
        """Outermost object of the file, its `format` and `version` checked, all else unchecked. Raises `error`."""
        data = self._json()
        if not isinstance(data, dict):
            self.fail(["the file"], in_short(data), "an object { } is needed")
        if data.get("format") != kind:
            self.fail(["format"], f"{data.get('format')!r:.80}", f"a {self.kind} says {kind!r}")
        if type(data.get("version")) is not int or data["version"] != version:
            self.fail(["version"], f"{data.get('version')!r:.80}", f"this program reads version {version}")
        return data

    def _json(self) -> Any:
        """Parsed content of the file. Raises `error` where the file is missing, too large, or not strict JSON."""

        def constant(name: str) -> NoReturn:
            raise self.error(f"{self.path}: found {name}; a {self.kind} holds finite numbers only")

        try:
            if self.path.exists() and not self.path.is_file():  # reading a pipe would wait for ever
                raise self.error(f"{self.path}: this is no file, so no {self.kind}")
            if self.path.stat().st_size > self.size_limit:
                limit = f"{self.size_limit // 1_000_000} MB"
                raise self.error(f"{self.path}: larger than {limit}, this is no {self.kind}")
            return json.loads(self.path.read_text(encoding="utf-8"), parse_constant=constant)
        except FileNotFoundError:
            raise self.error(f"{self.path}: no such {self.kind}") from None
        except (OSError, UnicodeDecodeError) as error:
            raise self.error(f"{self.path}: cannot be read as text ({error})") from None
        except json.JSONDecodeError as error:
            where = f"line {error.lineno}, column {error.colno}"
            raise self.error(f"{self.path}: {where}: not valid JSON ({error.msg}); {self.remedy}") from None
        except (RecursionError, ValueError) as error:  # nested a thousand deep, a number of a thousand digits
            raise self.error(f"{self.path}: not a {self.kind} ({type(error).__name__})") from None

    def fail(self, place: Place, found: str, remedy: str) -> NoReturn:
        """Raise `error`, naming file, place, what was found and what is needed."""
        keys = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place)
        raise self.error(f"{self.path}: {keys.removeprefix('.')}: found {found}; {remedy}")

    def checked(self, place: Place, value: Any, kind: type[T], dec_hook: Callable[[type, Any], Any] | None = None) -> T:
        """A value of the file, at `place`, converted to `kind`. Raises `error` where it is of another kind."""
        try:
            return msgspec.convert(value, kind, dec_hook=dec_hook)
        except msgspec.ValidationError as error:
            message = str(error)
        inside = _place_in(message)
        found = _value_at(value, inside)
        if missing := re.match(r"Object missing required field `(\w+)`", message):
            # msgspec's error about a null in its place says what is needed there.
            return self.checked(place, _with(value, inside, {**found, missing[1]: None}), kind, dec_hook)
        if "of length" in message and isinstance(found, list):
            self.fail([*place, *inside], f"{len(found)} entries", f"{LIST_LIMIT} are the most")
        number = f"{found:g}" if "> 0" in message else in_short(found)
        needs = (needed for expected, needed in _REMEDIES if message.startswith(f"Expected {expected}"))
        self.fail([*place, *inside], number, next(needs, OUT_OF_RANGE))

    def checked_values(self, place: Place, values: Mapping[str, Any], kind: type[T]) -> dict[str, T]:
        """Values of a mapping, each converted by itself (`checked`), since msgspec's errors do not name the key."""
        return {key: self.checked([*place, key], value, kind) for key, value in values.items()}


def in_short(value: Any) -> str:
    """Text of a value as JSON or Python writes it, cut to 60 characters for an error message."""
    if value is None:
        return "nothing"
    return f"{value!r:.60}".replace("\n", " ") + (" ..." if len(repr(value)) > 60 else "")


def _place_in(message: str) -> Place:
    """Keys and indices of the place that msgspec's message names, as in "... - at `$.history[2].label`"."""
    place = re.search(r" - at `\$(.*)`\Z", message)
    steps = re.findall(r"\.(\w+)|\[(\d+)\]", place[1] if place else "")
    return [key or int(index) for key, index in steps]


def _value_at(value: Any, place: Place) -> Any:
    """The value inside another at a place of keys and indices."""
    for key in place:
        value = value[key]
    return value


def _with(value: Any, place: Place, new: Any) -> Any:
    """A copy of a value with `new` at the given place; nothing is changed in place."""
    if not place:
        return new
    first, *rest = place
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[first] = _with(value[first], rest, new)  # type: ignore[index]
    return copy


def to_json(document: Mapping[str, Any]) -> str:
    """Strict JSON text of a document: numbers that are not finite become null, hidden characters JSON escapes."""
    return with_escapes(json.dumps(plain(document), allow_nan=False, ensure_ascii=False))


def with_escapes(text: str) -> str:
    """JSON text whose hidden characters, which occur in its strings alone, are replaced by JSON escapes."""
    if visible(text) == text:
        return text
    return "".join(c if visible(c) == c else json.dumps(c)[1:-1] for c in text)


def plain(value: Any) -> Any:
    """The value as strings, numbers, lists, dicts and None: arrays become lists, numbers that are not finite None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
