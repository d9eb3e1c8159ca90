"""JSON from a file that someone else may have written: every value is checked, an error is one line with its place.

Structs say what a file holds and msgspec checks it. What it says of an error is told in our words, since it names the
type that is needed but not what was found, and among the values of a mapping not the one that it means. The text
itself is read by json, which tells line and column of a mistake.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NoReturn, TypeVar

import msgspec
from msgspec import Meta

from calib.errors import CalibError

SIZE_LIMIT = 10_000_000  # bytes; a long session is some 100 kB
TEXT_LIMIT = 2_000
LIST_LIMIT = 1_000

Text = Annotated[str, Meta(min_length=1, max_length=TEXT_LIMIT, pattern=r"\A[^\0]*\Z")]
Texts = Annotated[tuple[Text, ...], Meta(max_length=LIST_LIMIT)]
Finite = Annotated[float, Meta(ge=-sys.float_info.max, le=sys.float_info.max)]
AboveZero = Annotated[float, Meta(gt=0.0, le=sys.float_info.max)]

T = TypeVar("T")
Place = list[str | int]  # keys and indices from the outermost value inwards

OUT_OF_RANGE = "a finite number is needed"
_REMEDIES = (  # by what msgspec says that it expects
    ("`float` > 0", "a number above 0 is needed"),
    ("`float", OUT_OF_RANGE),
    ("`bool", "true or false is needed"),
    ("`str", "a text is needed"),
    ("`array", "a list [ ] is needed"),
    ("`object", "an object { } is needed"),
)


class SessionFileError(CalibError):
    """A session file cannot be used."""


def read_object(path: Path) -> dict[str, Any]:
    """The file's outermost object, unchecked. Raises SessionFileError."""
    data = _json(path)
    if not isinstance(data, dict):
        fail(path, ["the file"], in_short(data), "an object { } is needed")
    return data


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


def fail(path: Path, place: Place, found: str, remedy: str) -> NoReturn:
    """Raise SessionFileError, naming file and place."""
    keys = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place)
    raise SessionFileError(f"{path}: {keys.removeprefix('.')}: found {found}; {remedy}")


def checked(path: Path, place: Place, value: Any, kind: type[T]) -> T:
    """The value at this place of the file as one of this kind. Raises SessionFileError where it is none."""
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        said = str(error)
    inside = _place_in(said)
    found = _value_at(value, inside)
    if missing := re.match(r"Object missing required field `(\w+)`", said):
        # What is said of a null there is what is needed there.
        return checked(path, place, _with(value, inside, {**found, missing[1]: None}), kind)
    if "of length" in said and isinstance(found, list):
        fail(path, [*place, *inside], f"{len(found)} entries", f"{LIST_LIMIT} are the most")
    told = f"{found:g}" if "> 0" in said else in_short(found)
    needs = (needed for expected, needed in _REMEDIES if said.startswith(f"Expected {expected}"))
    fail(path, [*place, *inside], told, next(needs, OUT_OF_RANGE))


def checked_values(path: Path, place: Place, values: Mapping[str, Any], kind: type[T]) -> dict[str, T]:
    """As `checked`, each value of a mapping: msgspec's errors do not tell which of them is meant."""
    return {key: checked(path, [*place, key], value, kind) for key, value in values.items()}


def in_short(value: Any) -> str:
    """What stands there, short enough for a line."""
    if value is None:
        return "nothing"
    return f"{value!r:.60}".replace("\n", " ") + (" ..." if len(repr(value)) > 60 else "")


def _place_in(said: str) -> Place:
    """The keys and indices in "... - at `$.history[2].label`"."""
    told = re.search(r" - at `\$(.*)`\Z", said)
    steps = re.findall(r"\.(\w+)|\[(\d+)\]", told[1] if told else "")
    return [key or int(index) for key, index in steps]


def _value_at(value: Any, place: Place) -> Any:
    for key in place:
        value = value[key]
    return value


def _with(value: Any, place: Place, new: Any) -> Any:
    """The value with something else at this place; nothing is changed in place."""
    if not place:
        return new
    first, *rest = place
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[first] = _with(value[first], rest, new)  # type: ignore[index]
    return copy
