"""What changed in a cell since a calibration, in the form in which a plug-in that can tell it answers.

Nothing slow is imported, as plug-ins are read at every start.
"""

from __future__ import annotations

from dataclasses import dataclass

NOT_OF_THE_ARM = ("scanner", "base", "jig", "noise")
"""Kinds of changes that are not of the arm itself."""


@dataclass(frozen=True)
class Change:
    """Estimate of one change of a cell, with its sigma and p-value."""

    what: str
    joint: int | None
    parameter: str
    size: float  # norm of `vector` where there is one
    sigma: float
    unit: str
    p_value: float
    as_well: tuple[str, ...]  # labels of changes that are confounded with this one at these poses
    vector: tuple[float, ...] = ()  # shift of the tool, tool frame, mm; shift (mm) and rotation (rad) of the scanner


@dataclass(frozen=True)
class CellChanges:
    """Changes of a cell between a calibration and a later dataset."""

    verdict: str  # unchanged, changed, unclear
    changes: tuple[Change, ...]
    rmse_mm: float  # 3D error of the later points by the calibration
    expected_mm: float  # part of rmse_mm that noise and the fit's uncertainty alone make
    poses: int  # of the later dataset that were compared
    data_problem: str = ""  # what is wrong with the later poses.csv; one line


@dataclass(frozen=True)
class ChangeTest:
    """A test for changes of a cell, as `watch` has it; a place is "module:name"."""

    compare: str  # place of a function from a calibration and a later dataset to `CellChanges`
    phrase: str  # place of a function from a `Change` to a phrase on it
