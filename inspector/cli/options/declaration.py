"""Command lines from declarations: a frozen dataclass is a command, its docstring the help, its fields the arguments.

A field is declared by `argument` (told by its place), `option`, `flag` or `several`. Its type says how the text is
read: as it stands, as a `Path`, an `int` or a `float`, or else by the `parse` that is given. Options that many commands
take are dataclasses to inherit from. A field that is declared otherwise is none of the command line's.
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, dataclass, field
from inspect import get_annotations
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

Parse = Callable[[str], object]  # raises argparse.ArgumentTypeError with one line

_TOLD = "argument"  # key of a field's metadata


@dataclass(frozen=True, kw_only=True)
class Argument:
    """What the command line has of a field beside its name, type and default."""

    help: str
    metavar: str | None = None
    parse: Parse | None = None
    choices: Sequence[str] | None = None
    spelled: Sequence[str] = ()  # by default --NAME-OF-THE-FIELD
    group: str = ""  # of options that exclude each other; one of them is required where they are
    required: bool = False
    by_place: bool = False
    is_flag: bool = False
    repeated: bool = False


def argument(
    help: str,
    *,
    metavar: str | None = None,
    choices: Sequence[str] | None = None,
    required: bool = True,
    repeated: bool = False,
) -> Any:
    """Field of an argument that is told by its place."""
    told = Argument(help=help, metavar=metavar, choices=choices, required=required, repeated=repeated, by_place=True)
    return field(default=MISSING if required else None, metadata={_TOLD: told})


def option(
    help: str,
    default: object = None,
    *,
    metavar: str | None = None,
    parse: Parse | None = None,
    choices: Sequence[str] | None = None,
    spelled: Sequence[str] = (),
    group: str = "",
    required: bool = False,
) -> Any:
    """Field of an option with a value."""
    told = Argument(
        help=help, metavar=metavar, parse=parse, choices=choices, spelled=spelled, group=group, required=required
    )
    return field(default=MISSING if required else default, metadata={_TOLD: told})


def flag(help: str, *, group: str = "") -> Any:
    """Field of an option that is there or not."""
    return field(default=False, metadata={_TOLD: Argument(help=help, group=group, is_flag=True)})


def several(help: str, *, metavar: str, parse: Parse | None = None, spelled: Sequence[str] = ()) -> Any:
    """Field of an option that may be given several times: a sequence."""
    told = Argument(help=help, metavar=metavar, parse=parse, spelled=spelled, repeated=True)
    return field(default=(), metadata={_TOLD: told})


def help_of(declaration: type) -> str:
    """Help of a command: its docstring's first paragraph, as a phrase."""
    words = " ".join((declaration.__doc__ or "").partition("\n\n")[0].split())
    return words[:1].lower() + words[1:].removesuffix(".")


def arguments_of(declaration: type) -> Iterator[tuple[str, Argument, Any]]:
    """Name of each declared field, what the command line has of it, and its type.

    A command's own come first, then those that it inherits, in the order of its bases.
    """
    types = get_type_hints(declaration)
    names = dict.fromkeys(name for each in declaration.__mro__ for name in get_annotations(each))
    fields = declaration.__dataclass_fields__  # type: ignore[attr-defined]
    for name in names:
        told = fields[name].metadata.get(_TOLD)
        if told is not None:
            yield name, told, types[name]


def add_arguments(parser: ArgumentParser, *declarations: type) -> None:
    """Add the arguments of declarations; groups of one name are one group."""
    groups: dict[str, Any] = {}
    for declaration in declarations:
        for name, told, type_ in arguments_of(declaration):
            if told.group and told.group not in groups:
                groups[told.group] = parser.add_mutually_exclusive_group(required=told.required)
            default = declaration.__dataclass_fields__[name].default  # type: ignore[attr-defined]
            into = groups.get(told.group, parser)
            into.add_argument(*_spelled(name, told), **_keywords(name, told, type_, default))


def _spelled(name: str, told: Argument) -> Sequence[str]:
    return [name] if told.by_place else told.spelled or [f"--{name.replace('_', '-')}"]


def _keywords(name: str, told: Argument, type_: Any, default: object) -> dict[str, Any]:
    """What `add_argument` is told; argparse refuses what an argument has no use for."""
    if told.is_flag:
        return {"help": told.help, "dest": name, "action": "store_true"}
    read = told.parse or _reader(type_)
    asked = {"help": told.help, "metavar": told.metavar, "choices": told.choices, "type": read}
    if told.by_place:
        return asked | {"nargs": "+" if told.repeated else None if told.required else "?"}
    asked["dest"] = name
    if told.repeated:
        return asked | {"action": "append", "default": []}
    required = told.required and not told.group
    return asked | {"required": required, "default": None if default is MISSING else default}


def _reader(type_: Any) -> Parse | None:
    """What reads a text as a field's type, a union or a sequence by its first; None for text itself."""
    if get_origin(type_) is not None:
        return _reader(get_args(type_)[0])
    return type_ if type_ in (Path, int, float) else None
