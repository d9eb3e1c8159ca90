"""Commands as tools: name, typed arguments and description of each, and the command line of a call."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from inspect import Parameter, Signature
from keyword import iskeyword
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, Strict

from calib.errors import CalibError
from inspector.cli.commands import commands, declarations
from inspector.cli.options import values
from inspector.cli.options.declaration import Argument, arguments_of, help_of, metavar_of, spelling, value_type
from inspector.extras.mcp.roots import Roots
from inspector.plugins import Command

NOT_OFFERED = ("serve", "mcp")  # they end when they are told to
RUN_CODE = ("effects_file", "finder")  # options that run a Python file of the user's
JSON_KEYS = "json_keys"
_NEVER = {"json", "once", "xacro_arg"}  # what a tool decides, and what none has a use for
_ALWAYS = {"follow": ["--once"]}
_XACRO = ".xacro"


class CallError(CalibError):
    """Error: a call that names no tool, or arguments that it does not take."""


Keys = Annotated[
    list[str], Field(description="answer with these keys of the JSON document instead of the text; [] lists the keys")
]


@dataclass(frozen=True)
class CommandTool:
    """A command as a tool.

    Attributes:
        arguments: of the command line, by their names in a call.
    """

    name: str
    help: str
    arguments: Mapping[str, Argument]

    @classmethod
    def of(cls, command: Command, *, allow_code: bool) -> CommandTool:
        """Tool of a command, with or without the options that run code."""
        left_out = _NEVER if allow_code else _NEVER.union(RUN_CODE)
        declared = declarations(command)
        told = [one for one in arguments_of(*declared) if one.name not in left_out]
        return cls(command.name, help_of(declared[0]), {key_of(one): one for one in told})

    @property
    def description(self) -> str:
        """What the command does, and what it answers with."""
        return f"{self.help}. Answers with the text of the terminal."

    @property
    def gives_json(self) -> bool:
        """Whether the command takes --json and answers with one object."""
        return self.name != "follow"  # which answers with a line a pose

    def signature(self) -> Signature:
        """The arguments of a call: those of the command line, by their long names."""
        parameters = [
            Parameter(
                f"{key}_" if iskeyword(key) else key,
                Parameter.KEYWORD_ONLY,
                default=Parameter.empty if told.required and not told.group else None,
                annotation=Annotated[_type(told), Field(description=_help(told), alias=key)],
            )
            for key, told in self.arguments.items()
        ]
        if self.gives_json:
            parameters.append(Parameter(JSON_KEYS, Parameter.KEYWORD_ONLY, default=None, annotation=Keys))
        return Signature(parameters)

    def words(self, given: Mapping[str, Any], roots: Roots) -> list[str]:
        """Words of the command line for the arguments of a call, which are of their types.

        Raises RootError for a place outside the roots, and CallError for a file that is expanded in a terminal alone.
        """
        placed: list[str] = []
        options: list[str] = list(_ALWAYS.get(self.name, ()))
        for key, told in self.arguments.items():
            value = given.get(key)
            if value is None or value is False:
                continue
            if value is True:
                options.append(spelling(told))
                continue
            texts = [str(one) for one in (value if isinstance(value, list) else [value])]
            for text in texts:
                _check_place(told, text, roots)
            # "=", so that "-1,0,0" is a value and no option.
            placed += texts if told.by_place else []
            options += [] if told.by_place else [f"{spelling(told)}={text}" for text in texts]
        return [self.name, *options, "--", *placed] if placed else [self.name, *options]


def command_tools(*, allow_code: bool) -> dict[str, CommandTool]:
    """Tools by name.

    Args:
        allow_code: whether options that run a Python file are offered.
    """
    offered = (command for command in commands().values() if command.name not in NOT_OFFERED)
    return {command.name: CommandTool.of(command, allow_code=allow_code) for command in offered}


def key_of(told: Argument) -> str:
    """Name of an argument in a call: its spelling, without dashes before it."""
    return spelling(told).lstrip("-").replace("-", "_")


def _help(told: Argument) -> str:
    metavar = metavar_of(told)
    shown = f" ({metavar})" if metavar and not told.by_place else ""
    return f"{told.help.replace('%%', '%')}{shown}"


def _type(told: Argument) -> Any:
    """Type of a call's argument."""
    plain = bool if told.is_flag else value_type(told.type)
    one: Any = Annotated[plain, Strict()] if plain in (bool, int, float) else str
    if told.choices is not None:
        one = Literal[tuple(told.choices)]
    return list[one] if told.repeated else one


def _check_place(told: Argument, text: str, roots: Roots) -> None:
    """Raise RootError where a value is a place outside the roots, CallError where it is a xacro.

    A value of type `Path` is a place, the folder of NAME=FOLDER, and any other that looks like one, as a robot's file.
    """
    place = text.partition("=")[2] if told.parse is values.named_folder else text
    plain = value_type(told.type)
    as_it_stands = plain is str and told.parse is None and told.choices is None
    looks_like_one = as_it_stands and ("/" in text or "\\" in text or bool(Path(text).suffix))
    if told.parse is values.named_folder or plain is Path or looks_like_one:
        for end in [k for k, mark in enumerate(place) if mark == "#"] + [len(place)]:  # topics and sheets follow a "#"
            roots.require(place[:end])
        if Path(place).suffix.lower() == _XACRO:
            urdf = Path(place).with_suffix("" if place.lower().endswith(f".urdf{_XACRO}") else ".urdf")
            raise CallError(
                f"{place}: a .xacro reads other files and computes, which is not done here; in a terminal, "
                f"`inspector convert {place} {urdf}` expands it"
            )
