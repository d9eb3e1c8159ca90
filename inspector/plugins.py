"""Kinds of what a plug-in brings to the commands and the page; `calib.plugins` tells how a plug-in is found.

A "place" is "module:name", imported when it is first used.
"""

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
class CommandOptions:
    """Further options of one of core's commands.

    They are a dataclass as a command's, in which every field has a default. Where one of them is given, the class that
    `does` names is made of them and of the command's own options; the command asks it at its places, which are the
    methods of `inspector.cli.additions.CalibrateAddition`, `PlanAddition`,
    `CorrectAddition` and `ImportAddition`.
    """

    command: str
    options: str  # "module:class"
    does: str  # "module:class"


@dataclass(frozen=True)
class PipExtra:
    """Packages that not every installation has, and the extra of pyproject.toml that brings them.

    Where a command ends for the want of one, it is refused with the words that install it.
    """

    name: str
    modules: tuple[str, ...]  # as they are imported


@dataclass(frozen=True)
class Tab:
    """A tab of the page, with its panel and what works for it."""

    step: str  # of the work, to which the tab belongs: "Measure", "Model", "Learn", "Take away"
    name: str  # that of the step where the step is a single tab
    order: int  # among the tabs of its step, which have 10, 20, 30 ...
    panel: str = ""  # place of a class that takes (gui, actions); "" for the page's own, whose class is known
    controller: str = ""  # place of a `TabController` (`inspector.app.page.tab_controller`), if the panel needs one
    view: str = ""  # what the 3D view shows once the tab is opened; "" leaves the view as it is


@dataclass(frozen=True)
class Figures:
    """Functions that draw results, as `inspector.figures` offers them and blocks of `calib.present` name them."""

    module: str
    names: tuple[str, ...]


@dataclass(frozen=True)
class PoseView:
    """What the tab of scans and points shows of datasets that an instrument of a plug-in measured."""

    of_view: str  # place of a function from a View to an `inspector.panels.measure.scans.ShownPose`, None for others


@dataclass(frozen=True)
class Download:
    """A file of the tab Take away."""

    group: str  # heading that it stands under: "Report", "Robot", "Data", "Session", or one of its own
    name: str  # on the button
    holds: str  # a sentence on what is in it
    make: str  # place of a function from `Asked` (`inspector.app.controllers.downloads`) to the file's name and bytes
    icon: str = "download"  # of viser's, see `viser.Icon`
    command: str = ""  # the same at the terminal


@dataclass(frozen=True)
class TargetFile:
    """Files of an arm's targets that a page brings to be corrected."""

    suffixes: tuple[str, ...]
    read: str  # place of a function (path, robot) -> targets, which is called in a bounded process
    correct: str  # place of a function (targets, robot, model) -> the file's bytes, and blocks of what is told of it


@dataclass(frozen=True)
class PlanFile:
    """Files of a plan that the page's tab *Plan* offers by a button."""

    group: str  # of buttons in a row: "Download"
    name: str  # on the button
    file: str  # name of the file, or of the first of several
    writer: str  # "module:function" (path, plan) -> text by path
    turning_joints: int = 0  # that its form holds, and no others; 0: those of any arm
    hint: str = ""  # of the row of buttons


def contributions(kind: type[Kind]) -> tuple[Kind, ...]:
    """All contributions of one kind to the commands and the page."""
    return plugins.contributions(kind, EXTRAS)


def left_out() -> tuple[str, ...]:
    """A line for each plug-in of the method, the commands or the page that could not be imported."""
    return tuple(dict.fromkeys((*plugins.left_out(), *plugins.left_out(EXTRAS))))
