"""Kinds of what a plug-in brings to the commands and the page; `calib.plugins` tells how a plug-in is found."""

from __future__ import annotations

from dataclasses import dataclass

from calib import plugins
from calib.plugins import Kind

EXTRAS = "inspector.extras"


@dataclass(frozen=True)
class Command:
    """A command, core's own or a plug-in's.

    Its options are a frozen dataclass whose docstring is the command's help and whose fields are the arguments
    (`inspector.cli.options.declaration`). All are read at every start, so that its module imports nothing slow; the
    module of the function that runs is loaded when it runs. The function takes the options and returns the exit code.
    """

    name: str
    options: str  # "module:class"
    run: str  # "module:function"
    after: str = ""  # the command behind which it stands in `--help`; the last where there is none of this name


@dataclass(frozen=True)
class PipExtra:
    """Packages that not every installation has, and the extra of pyproject.toml that brings them.

    Where a command ends for the want of one, it is refused with the words that install it.
    """

    name: str
    modules: tuple[str, ...]  # as they are imported


def contributions(kind: type[Kind]) -> tuple[Kind, ...]:
    """All contributions of one kind to the commands and the page."""
    return plugins.contributions(kind, EXTRAS)


def left_out() -> tuple[str, ...]:
    """A line for each plug-in of the method, the commands or the page that could not be imported."""
    return tuple(dict.fromkeys((*plugins.left_out(), *plugins.left_out(EXTRAS))))
