"""A command line from a declaration: a dataclass, whose docstring is the help and whose fields are the arguments."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from inspector.cli.options.declaration import add_arguments, argument, flag, help_of, option, several


@dataclass(frozen=True, kw_only=True)
class WithSpeed:
    """Option to inherit."""

    speed: float | None = option("of the arm", metavar="X")


@dataclass(frozen=True, kw_only=True)
class MoveOptions(WithSpeed):
    """Move an arm: slowly, or
    at once.

    What follows is no help.
    """

    path: Path = argument("where to", metavar="PATH")
    joints: Sequence[int] = several("which", metavar="N")
    source: str | None = option("of what", spelled=["--from"], group="start", required=True)
    slowly: bool = flag("not at once")
    kept: object = None  # none of the command line's


@dataclass(frozen=True, kw_only=True)
class AddedOptions:
    """What a plug-in adds."""

    here: bool = flag("begin here", group="start")


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(exit_on_error=False)
    add_arguments(parser, MoveOptions, AddedOptions)
    return parser.parse_args(words)


def test_types_read_the_words_and_defaults_are_the_fields() -> None:
    given = vars(parsed("a/b", "--joints", "2", "--joints", "3", "--from", "x"))
    assert given == {
        "path": Path("a/b"), "joints": [2, 3], "source": "x", "slowly": False, "speed": None, "here": False,
    }  # fmt: skip
    assert parsed("a", "--here", "--speed", "2.5", "--slowly").speed == 2.5


@pytest.mark.parametrize("words", [("a",), ("a", "--here", "--from", "x")])
def test_a_group_of_two_declarations_is_one(words: tuple[str, ...]) -> None:
    with pytest.raises((argparse.ArgumentError, SystemExit)):
        parsed(*words)


def test_the_help_is_the_first_paragraph_and_own_arguments_come_first() -> None:
    assert help_of(MoveOptions) == "move an arm: slowly, or at once"
    parser = argparse.ArgumentParser()
    add_arguments(parser, MoveOptions, AddedOptions)
    assert [action.dest for action in parser._actions[1:]] == ["path", "joints", "source", "here", "slowly", "speed"]
