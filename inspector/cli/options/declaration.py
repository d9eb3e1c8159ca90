"""Command lines from declarations: a frozen dataclass is a command, its docstring the help, its fields the arguments.

A field is declared by `argument` (told by its place), `option`, `flag` or `several`. Its type says how the text is
read: as it stands, as a `Path`, an `int` or a `float`, or else by the `parse` that is given. Options that many commands
take are dataclasses to inherit from. A field that is declared otherwise is none of the command line's.
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from inspect import get_annotations
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

Parse = Callable[[str], object]  # raises argparse.ArgumentTypeError with one line

_TOLD = "argument"  # key of a field's metadata


@dataclass(frozen=True, kw_only=True)
class Argument:
    """What a field is on the command line. Name, type and default are those of the field, see `arguments_of`."""

    help: str
    name: str = ""
    type: Any = str
    default: object = None
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
    return field(default=MISSING if required and not group else default, metadata={_TOLD: told})


def flag(help: str, *, group: str = "") -> Any:
    """Field of an option that is there or not."""
    return field(default=False, metadata={_TOLD: Argument(help=help, group=group, is_flag=True)})


def several(help: str, *, metavar: str | None = None, parse: Parse | None = None, spelled: Sequence[str] = ()) -> Any:
    """Field of an option that may be given several times: a sequence."""
    told = Argument(help=help, metavar=metavar, parse=parse, spelled=spelled, repeated=True)
    return field(default=(), metadata={_TOLD: told})


def help_of(declaration: type) -> str:
    """Help of a command: its docstring's first paragraph, as a phrase."""
    words = " ".join((declaration.__doc__ or "").partition("\n\n")[0].split())
    return words[:1].lower() + words[1:].removesuffix(".")


def arguments_of(*declarations: type) -> list[Argument]:
    """The arguments of declarations, those of a group together.

    A command's own come first, then those that it inherits, in the order of its bases.
    """
    found = []
    for declaration in declarations:
        types = get_type_hints(declaration)
        declared = {each.name: each for each in fields(declaration)}
        for name in dict.fromkeys(name for base in declaration.__mro__ for name in get_annotations(base)):
            told = declared[name].metadata.get(_TOLD)
            if told is not None:
                default = None if declared[name].default is MISSING else declared[name].default
                found.append(replace(told, name=name, type=types[name], default=default))
    place: dict[str, int] = {}
    for at, told in enumerate(found):
        place.setdefault(told.group or told.name, at)
    return sorted(found, key=lambda told: place[told.group or told.name])


def add_arguments(parser: ArgumentParser, *declarations: type) -> None:
    """Add the arguments of declarations; groups of one name are one group."""
    groups: dict[str, Any] = {}
    for told in arguments_of(*declarations):
        if told.group and told.group not in groups:
            groups[told.group] = parser.add_mutually_exclusive_group(required=told.required)
        groups.get(told.group, parser).add_argument(*(told.spelled or [spelling(told)]), **_keywords(told))


def spelling(told: Argument) -> str:
    """How an argument is typed: the option, or the name of what is told by its place."""
    return told.name if told.by_place else next(iter(told.spelled), f"--{told.name.replace('_', '-')}")


def value_type(type_: Any) -> Any:
    """Type of one value of a field: the first of a union, that of a sequence's items; a tuple is read whole."""
    origin = get_origin(type_)
    return origin or type_ if origin in (None, tuple) else value_type(get_args(type_)[0])


def metavar_of(told: Argument) -> str | None:
    """Word for the value: FILE for a path, its name for what is told by its place; None is argparse's own."""
    usual = told.name.upper() if told.by_place else "FILE" if value_type(told.type) is Path else None
    return told.metavar or (None if told.choices else usual)


def _keywords(told: Argument) -> dict[str, Any]:
    """What `add_argument` is told; argparse refuses what an argument has no use for."""
    if told.is_flag:
        return {"help": told.help, "dest": told.name, "action": "store_true"}
    type_ = value_type(told.type)
    read = told.parse or (type_ if type_ in (Path, int, float) else None)
    asked = {"help": told.help, "metavar": metavar_of(told), "choices": told.choices, "type": read}
    if told.by_place:
        return asked | {"nargs": "+" if told.repeated else None if told.required else "?"}
    asked["dest"] = told.name
    if told.repeated:
        return asked | {"action": "append", "default": []}
    return asked | {"required": told.required and not told.group, "default": told.default}
