"""Sphinx: `{command-options} NAME` is the table of a command's options, as argparse has them.

What a command takes is told once, in its declaration; `{command-options} fit` are those that all fits share.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from inspector.cli.commands import commands, declarations, lacking
from inspector.cli.options.declaration import add_arguments
from inspector.cli.options.shared import FittingOptions

FIT = "fit"


def actions(*declared: type) -> list[argparse.Action]:
    """What a command is asked for beside PATH, in its order."""
    parser = argparse.ArgumentParser(add_help=False)
    add_arguments(parser, *declared)
    return [action for action in parser._actions if action.dest != "path"]


def table_of(name: str) -> tuple[list[argparse.Action], bool]:
    """A command's arguments, without those of a fit where it takes them all, and whether it does."""
    fit = [action for action in actions(FittingOptions) if action.dest != "json"]
    if name == FIT:
        return fit, False
    own = actions(*declarations(commands()[name]))
    shared = {option for action in fit for option in action.option_strings}
    takes_fit = shared <= {option for action in own for option in action.option_strings}
    if takes_fit:
        own = [action for action in own if not shared & set(action.option_strings)]
    return own, takes_fit


def spelling(action: argparse.Action) -> str:
    """How it is typed: `--out FILE`, `--residual position|distance`, `IN`."""
    value = action.metavar if isinstance(action.metavar, str) else None
    if action.choices is not None:
        value = "|".join(str(choice) for choice in action.choices)
    if not action.option_strings:
        return value or action.dest
    if action.nargs == 0:
        return action.option_strings[0]
    return f"{action.option_strings[0]} {value or action.dest.upper()}"


class CommandOptions(SphinxDirective):
    """A table: the option, and what it does."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The nodes; an unknown name is an error of the page."""
        name = self.arguments[0]
        if lacks := lacking([name]):
            return [nodes.paragraph("", f"{lacks}.")]
        if name not in {FIT, *commands()}:
            raise self.error(f"{name!r} is no command")
        options, takes_fit = table_of(name)
        made: list[nodes.Node] = []
        if options:
            made.append(_table(options))
        if takes_fit:
            paragraph = nodes.paragraph("", "It also takes ")
            paragraph += nodes.reference("", "the options of a fit", refid="options-of-a-fit")
            paragraph += nodes.Text(".")
            made.append(paragraph)
        return made


def _table(options: list[argparse.Action]) -> nodes.table:
    group = nodes.tgroup("", *(nodes.colspec(colwidth=width) for width in (35, 65)), cols=2)
    group += nodes.thead("", _row(nodes.Text("option"), nodes.Text("does")))
    body = nodes.tbody()
    for action in options:
        body += _row(nodes.literal("", spelling(action)), nodes.Text(action.help or ""))
    group += body
    return nodes.table("", group)


def _row(*cells: nodes.Node) -> nodes.row:
    return nodes.row("", *_entries(cells))


def _entries(cells: tuple[nodes.Node, ...]) -> Iterator[nodes.entry]:
    for cell in cells:
        yield nodes.entry("", nodes.paragraph("", "", cell))


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the directive."""
    app.add_directive("command-options", CommandOptions)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
