"""Where a plan begins: a fit of what was measured already, or an arm that was never measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset, Poses
from calib.effects.effect import Effect
from calib.errors import CalibError
from calib.fitting.observations import conditions_at
from calib.options import FitOptions
from calib.planning.unknowns import DEFAULT_NOISE_MM, Unknowns, unknowns_of_fit, unknowns_of_robot
from calib.workcell.known_cell import workcell_of_dataset
from calib.workcell.workcell import Workcell

NEW_SETUP = "new"


class Start(Protocol):
    """What a plan needs of its beginning."""

    @property
    def dataset(self) -> Dataset:
        """Robot, jig and scanner, with the measured poses where there are any."""
        ...

    @property
    def measured(self) -> Poses | None:
        """The poses that were measured already, test poses too."""
        ...

    @property
    def setup(self) -> str:
        """The placement of the scanner that new poses are measured from."""
        ...

    @property
    def cell(self) -> Workcell:
        """What decides which poses can be measured."""
        ...

    def unknowns(self, effects: Sequence[Effect] = ()) -> Unknowns:
        """The unknowns of the fit to come, these effects among them."""
        ...

    def poses_at(self, q: Array) -> Poses:
        """Poses to be measured at joints (N, n), under the usual conditions."""
        ...


@dataclass(frozen=True)
class DiagnosedModel:
    """Why a diagnosis chose the model to plan for, and whether it left anything open."""

    noise_ratio: float  # residual of the link errors alone over the declared noise
    confounded: bool  # whether effects stayed confounded


@dataclass(frozen=True)
class FromFit(Brief):
    """The next poses of a calibration; from where its scanner stood last, or from a further place."""

    calibration: Calibration
    scanner_place: Array | None = None  # (4, 4) base_T_scanner of a placement that was not measured from yet
    diagnosed: DiagnosedModel | None = None  # where a diagnosis chose the calibration's model

    @property
    def dataset(self) -> Dataset:
        return self.calibration.dataset

    @property
    def measured(self) -> Poses:
        return self.calibration.dataset.poses

    @property
    def setup(self) -> str:
        if self.scanner_place is None:
            return self._last_setup
        names = set(map(str, self.measured.setup))
        number = 1
        while (name := NEW_SETUP if number == 1 else f"{NEW_SETUP}{number}") in names:
            number += 1
        return name

    @property
    def _last_setup(self) -> str:
        """The setup of the training pose that was measured last."""
        poses, points = self.calibration.fitted_dataset.poses, self.calibration.fitted_dataset.points
        assert points is not None
        trained = points.pose[~poses.is_test[points.pose]]
        return str(poses.setup[trained[np.argmax(poses.order[trained])]])

    @cached_property
    def cell(self) -> Workcell:
        """With the fitted table, the scanner where the fit has it, or at the further place."""
        last = self._last_setup
        fitted = replace(self.dataset, robot=self.calibration.robot)
        seen_from = frames.invert(self.calibration.after.scanner_T_base[last])
        cell = workcell_of_dataset(fitted, base_T_scanner=seen_from, setup=last)
        return cell if self.scanner_place is None else replace(cell, base_T_scanner=self.scanner_place)

    def unknowns(self, effects: Sequence[Effect] = ()) -> Unknowns:
        return self._unknowns_with(effects) if effects else self._unknowns

    @cached_property
    def _unknowns(self) -> Unknowns:
        """The unknowns of the fit alone, kept because a plan asks for them several times."""
        return self._unknowns_with(())

    def _unknowns_with(self, effects: Sequence[Effect]) -> Unknowns:
        further = None if self.scanner_place is None else {self.setup: frames.invert(self.scanner_place)}
        return unknowns_of_fit(self.calibration, effects=effects, scanner_T_base=further)

    def poses_at(self, q: Array) -> Poses:
        poses, time_s = conditions_at(self.measured, q), self.measured.time_s
        later = None if time_s is None else np.full(len(q), time_s.max())
        return replace(poses, role=np.full(len(q), "train"), setup=np.full(len(q), self.setup), time_s=later)


@dataclass(frozen=True)
class FromRobot:
    """A first set of poses for an arm."""

    cell: Workcell  # with the scanner roughly where it will stand
    noise_mm: float = DEFAULT_NOISE_MM  # of a measured point, each axis
    options: FitOptions = field(default_factory=FitOptions)

    @property
    def dataset(self) -> Dataset:
        robot = self.cell.robot
        return Dataset(robot.name, robot, self.poses_at(np.zeros((0, robot.n_joints))))

    @property
    def measured(self) -> None:
        return None

    @property
    def setup(self) -> str:
        return ""

    def unknowns(self, effects: Sequence[Effect] = ()) -> Unknowns:
        if not self.options.prior:
            raise CalibError("a first set of poses is planned with tolerances; leave out --no-prior")
        place = np.eye(4) if self.cell.base_T_scanner is None else self.cell.base_T_scanner
        return unknowns_of_robot(
            self.cell.robot,
            place,
            noise_mm=self.noise_mm,
            effects=effects,
            tolerances=self.options.tolerances,
            held=self.options.fixed,
        )

    def poses_at(self, q: Array) -> Poses:
        n = len(q)
        ids = tuple(f"q{i + 1}" for i in range(n))
        return Poses(ids, np.full(n, "train"), q, np.full(n, ""), ids)
