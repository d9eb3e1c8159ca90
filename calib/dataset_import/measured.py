"""Measurements that a plug-in makes of files of its own, in place of a table of points or scans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, Self

from calib.array_types import Array
from calib.kinematics.robot import Robot


class MeasuredPoses(Protocol):
    """What was measured at poses of the arm's table, by their ids, ready to become a dataset."""

    @property
    def names(self) -> tuple[str, ...]:
        """Ids of the poses."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found and left out."""

    @property
    def doubts(self) -> tuple[str, ...]:
        """What to check before the dataset is used."""

    def settled(self, robot: Robot, ids: Sequence[str], q: Array, setups: Sequence[str]) -> Self:
        """The same with what the arm tells of it, by its N poses' ids and joints q (N, n), rad and mm, and more notes.

        setups: the instrument's placement at each pose, [] for one.

        Raises CalibError where the arm contradicts it.
        """

    def points_text(self, ids: Sequence[str]) -> str:
        """Text of points.csv for a dataset whose poses have these ids."""

    def scanner_table(self, declared: Mapping[str, Any]) -> dict[str, Any]:
        """Table [scanner] of dataset.toml, with what the user declared of it."""

    def write(self, folder: Path, *, with_files: bool) -> dict[str, Any]:
        """Write what stands in files of its own, large ones if `with_files`; returns further tables of dataset.toml."""
