"""Identifiability of the tool row by a dataset's measurements: single parameters, and those known only in sums.

The points of one target give a position, no orientation: a turn of the tool about the measured point moves nothing. A
length along the last joint's axis adds to the last link's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from calib.dataset.dataset import Dataset
from calib.effects.link_errors import target_parameter_names
from calib.fitting.model import Model
from calib.fitting.tool_point import behind_last_axis
from calib.identifiability.redundancy import Redundancy
from calib.identifiability.structural import redundancy_of

_ROW = "TCP"


@dataclass(frozen=True)
class ToolRows:
    """Parameters of the tool row by their identifiability, with the scanner's frame known."""

    known: tuple[str, ...]  # each alone
    sums: Mapping[str, tuple[str, ...]]  # known only in sums with these others
    unseen: tuple[str, ...]  # move no measured point, and stay as in robot.toml
    residual: str
    on_flange: bool = False  # the arm carries the scanner
    point: tuple[str, ...] = ()  # coordinates of a measured point of its own, that is not the end of the row


def tool_rows(dataset: Dataset, *, residual: str = "position", model: Model | None = None) -> ToolRows:
    """Identifiability of the tool row at a dataset's training poses, for the nominal robot or a fitted model."""
    own = None if model is None else model.robot.own_tool_point
    if model is not None and own is not None:
        unseen = tuple(name for name in behind_last_axis(model.robot) if name in model.fixed)
        return ToolRows((), {}, unseen, residual, point=target_parameter_names(own))
    rows = rows_of_tool(redundancy_of(dataset, residual=residual), residual)
    return replace(rows, on_flange=dataset.robot.carries_scanner)


def rows_of_tool(redundant: Redundancy, residual: str) -> ToolRows:
    """Identifiability of the tool row, taken from a redundancy analysis of all parameters."""
    mine = [name for name in redundant.parameters if name.endswith(_ROW) and "." not in name]
    unseen = tuple(name for name in mine if name in redundant.no_influence)
    relations = [*redundant.groups, *redundant.mixed_groups, *map(tuple, redundant.combinations)]
    sums = {}
    for name in mine:
        others = [other for relation in relations if name in relation for other in relation if other != name]
        if others and name not in unseen:
            sums[name] = tuple(dict.fromkeys(others))
    known = tuple(name for name in mine if name not in unseen and name not in sums)
    return ToolRows(known, sums, unseen, residual)
