"""Tools made of the commands: name, description and JSON schema of each, and the command line of a call."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.errors import CalibError
from calib.plugins import load
from inspector.cli.commands import commands
from inspector.cli.options import values
from inspector.cli.options.declaration import add_arguments, help_of
from inspector.extras.mcp.roots import Roots
from inspector.plugins import Command

NOT_OFFERED = ("serve", "mcp")  # they end when they are told to
RUN_CODE = ("effects_file", "finder")  # options that run a Python file of the user's
JSON_KEYS = "json_keys"
FIGURE = "figure"  # the tool that answers with a picture
_ALWAYS = {"follow": ["--once"]}
_NUMBERS = (float, values.rmse_mm, values.sigma_mm, values.mass_kg, values.seconds)
_WHOLE = (int, values.port, values.process_count, values.pose_count)


class ToolError(CalibError):
    """Error: a call that names no tool, or arguments that it does not take."""


@dataclass(frozen=True)
class CommandTool:
    """A command as a tool."""

    command: Command
    arguments: tuple[argparse.Action, ...]

    @property
    def name(self) -> str:
        """Name of the tool, which is the command's."""
        return self.command.name

    @property
    def description(self) -> str:
        """What the command does, and what it answers with."""
        return f"{help_of(load(self.command.options))}. Answers with the text of the terminal."

    def schema(self) -> dict[str, Any]:
        """JSON schema of the arguments: those of the command line, by their long names."""
        properties = {key_of(action): _property(action) for action in self.arguments}
        if self.gives_json:
            properties[JSON_KEYS] = {
                "type": "array",
                "items": {"type": "string"},
                "description": "answer with these keys of the JSON document instead of the text; [] lists the keys",
            }
        required = [key_of(action) for action in self.arguments if _is_required(action)]
        return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}

    @property
    def gives_json(self) -> bool:
        """Whether the command takes --json and answers with one object."""
        return self.name != "follow"  # which answers with a line a pose

    def words(self, given: Mapping[str, Any], roots: Roots) -> list[str]:
        """Words of the command line for the arguments of a call.

        Raises ToolError for an argument that the command does not take, and RootError for a place outside the roots.
        """
        known = {key_of(action): action for action in self.arguments}
        unknown = sorted(set(given) - set(known) - {JSON_KEYS})
        if unknown:
            raise ToolError(f"{self.name}: takes no {unknown[0]!r}; it takes {', '.join(known)}")
        missing = [key for key, action in known.items() if _is_required(action) and given.get(key) in (None, [])]
        if missing:
            raise ToolError(f"{self.name}: needs {missing[0]!r}: {_help(known[missing[0]])}")
        placed: list[str] = []
        options: list[str] = list(_ALWAYS.get(self.name, ()))
        for key, action in known.items():
            texts = _texts(self.name, key, action, given.get(key))
            for text in texts or ():
                _check_place(action, text, roots)
            if texts is None:
                continue
            if not action.option_strings:
                placed += texts
            elif action.nargs == 0:
                options.append(_flag(action))
            elif isinstance(action, argparse._AppendAction):
                options += [f"{_flag(action)}={text}" for text in texts]
            elif len(texts) == 1:
                options.append(f"{_flag(action)}={texts[0]}")  # so that "-1,0,0" is a value and no option
            else:
                options += [_flag(action), *texts]
        return [self.name, *options, "--", *placed] if placed else [self.name, *options]


def command_tools(*, allow_code: bool) -> dict[str, CommandTool]:
    """Tools by name.

    Args:
        allow_code: whether options that run a Python file are offered.
    """
    tools = {}
    for command in commands().values():
        if command.name in NOT_OFFERED:
            continue
        parser = argparse.ArgumentParser(add_help=False)
        add_arguments(parser, load(command.options))
        left_out = {"json", "once", *(() if allow_code else RUN_CODE)}
        taken = tuple(action for action in parser._actions if action.dest not in left_out)
        tools[command.name] = CommandTool(command, taken)
    return tools


def key_of(action: argparse.Action) -> str:
    """Name of an argument in a call: its longest spelling, without dashes before it."""
    flag = max(action.option_strings, key=len, default=action.dest)
    return flag.lstrip("-").replace("-", "_")


def _flag(action: argparse.Action) -> str:
    return max(action.option_strings, key=len)


def _is_required(action: argparse.Action) -> bool:
    return action.required if action.option_strings else action.nargs not in ("?", "*")


def _is_list(action: argparse.Action) -> bool:
    several = action.nargs in ("*", "+") or (isinstance(action.nargs, int) and action.nargs > 0)
    return several or isinstance(action, argparse._AppendAction)


def _help(action: argparse.Action) -> str:
    shown = f" ({action.metavar})" if isinstance(action.metavar, str) and action.option_strings else ""
    return f"{action.help or action.dest}{shown}"


def _property(action: argparse.Action) -> dict[str, Any]:
    if action.nargs == 0:
        return {"type": "boolean", "description": _help(action)}
    one: dict[str, Any] = {"type": _json_type(action)}
    if action.choices is not None:
        one["enum"] = list(action.choices)
    if not _is_list(action):
        return one | {"description": _help(action)}
    return {"type": "array", "items": one, "description": _help(action)}


def _json_type(action: argparse.Action) -> str:
    if action.type in _WHOLE:
        return "integer"
    return "number" if action.type in _NUMBERS else "string"


def _texts(tool: str, key: str, action: argparse.Action, value: object) -> list[str] | None:
    """The words of an argument's value; None where it is not given."""
    if value is None or value is False or value == []:
        return None
    if action.nargs == 0:
        if value is not True:
            raise ToolError(f"{tool}: {key} is true or false, found {value!r}")
        return []
    given: Sequence[object] = value if isinstance(value, list) else [value]
    if len(given) > 1 and not _is_list(action):
        raise ToolError(f"{tool}: {key} takes one value, found {len(given)}")
    wrong = [one for one in given if isinstance(one, bool) or not isinstance(one, str | int | float)]
    if wrong:
        raise ToolError(f"{tool}: {key} takes text or a number, found {wrong[0]!r}")
    return [str(one) for one in given]


def _check_place(action: argparse.Action, text: str, roots: Roots) -> None:
    """Raise RootError where a value is a place outside the roots.

    A value of type `Path` is one, the folder of NAME=FOLDER, and any other that looks like a path, as a robot's file.
    """
    if action.type is Path:
        roots.require(text)
    elif action.type is values.named_folder:
        roots.require(text.partition("=")[2])
    elif action.type is None and ("/" in text or "\\" in text or Path(text).suffix):
        roots.require(text)
