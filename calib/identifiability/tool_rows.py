"""What the measurements of a dataset can tell of [tool]: which parameters of its row, and which in sums only.

The points of one target tell a place, not an attitude: what turns the tool about the measured point moves nothing. A
length along the last joint's axis is one with the last link's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from calib.dataset.dataset import Dataset
from calib.effects.link_errors import target_parameter_names
from calib.fitting.model import Model
from calib.fitting.tool_point.placement import behind_last_axis
from calib.identifiability.redundancy import Redundancy
from calib.identifiability.structural import redundancy

_ROW = "TCP"


@dataclass(frozen=True)
class ToolRows:
    """The parameters of the tool row by what can be known of each, with the scanner's place known."""

    known: tuple[str, ...]  # each alone
    sums: Mapping[str, tuple[str, ...]]  # known only together with these: one of them at the nominal tells the other
    unseen: tuple[str, ...]  # move nothing that is measured, and stay as robot.toml has them
    residual: str
    on_flange: bool = False  # the arm carries the scanner
    point: tuple[str, ...] = ()  # where the measured point is one of its own, not the end of the row


def tool_rows(dataset: Dataset, *, residual: str = "position", model: Model | None = None) -> ToolRows:
    """What the dataset's training poses can tell of the tool row, for the nominal robot, or as a model has its tool."""
    own = None if model is None else model.robot.own_tool_point
    if model is not None and own is not None:
        unseen = tuple(name for name in behind_last_axis(model.robot) if name in model.held)
        return ToolRows((), {}, unseen, residual, point=target_parameter_names(own))
    rows = rows_of_tool(redundancy(dataset, residual=residual), residual)
    return replace(rows, on_flange=dataset.robot.carries_scanner)


def rows_of_tool(found: Redundancy, residual: str) -> ToolRows:
    """The tool row's parameters among those of an analysis."""
    mine = [name for name in found.parameters if name.endswith(_ROW) and "." not in name]
    unseen = tuple(name for name in mine if name in found.no_influence)
    relations = [*found.groups, *found.mixed_groups, *map(tuple, found.combinations)]
    sums = {}
    for name in mine:
        others = [other for relation in relations if name in relation for other in relation if other != name]
        if others and name not in unseen:
            sums[name] = tuple(dict.fromkeys(others))
    known = tuple(name for name in mine if name not in unseen and name not in sums)
    return ToolRows(known, sums, unseen, residual)
