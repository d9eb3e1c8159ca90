"""Kind of a plug-in that knows what an instrument of its own has to see at a pose."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ViewRule:
    """A rule of what an instrument sees, for the cells of datasets that it measured."""

    of_dataset: str  # "module:name", (Dataset, setup) -> calib.workcell.workcell.InView, or None where it measured none
