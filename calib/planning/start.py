"""Start of a plan: a fit of what was measured already, or an arm that was never measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.calibrate import fit_measured
from calib.calibration.noise_level import check_sigma
from calib.calibration.promise import missed_variance
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset, Poses
from calib.diagnosis.diagnose import whole_diagnosis
from calib.diagnosis.search_space import SearchSpace
from calib.effects.effect import Effect, Family
from calib.errors import CalibError
from calib.fitting.observations import conditions_at
from calib.options import FitOptions
from calib.planning.unknowns import (
    DEFAULT_NOISE_MM,
    Unknowns,
    require_points,
    require_scanner_in_room,
    unknowns_of_fit,
    unknowns_of_robot,
)
from calib.screening.blunders import without_blunders
from calib.workcell.known_cell import workcell_of_dataset
from calib.workcell.workcell import Workcell

NEW_SETUP = "new"


class Start(Protocol):
    """Start of a plan: the measured poses, the knowledge of the unknowns, and the cell that limits the poses."""

    @property
    def dataset(self) -> Dataset:
        """Dataset with robot, jig and scanner, and with the measured poses where there are any."""
        ...

    @property
    def measured(self) -> Poses | None:
        """Poses that were measured already, test poses included; None for an arm that was never measured."""
        ...

    @property
    def setup(self) -> str:
        """Name of the scanner's station (`Poses.setup`) from which new poses are measured."""
        ...

    @property
    def cell(self) -> Workcell:
        """Cell that decides which poses can be measured."""
        ...

    def unknowns(self, effects: Sequence[Effect] = ()) -> Unknowns:
        """Unknowns of the planned fit, including the coefficients of further effects."""
        ...

    def poses_at(self, q: Array) -> Poses:
        """Poses to be measured at joints q (N, n), rad or mm, under the usual conditions."""
        ...

    def missed_mm2(self, poses: Poses) -> float:
        """Mean square 3D error, mm^2, that the model is known to miss at given poses."""
        ...


@dataclass(frozen=True)
class DiagnosedModel:
    """Facts on the diagnosis that chose the model to plan for, and whether it left effects confounded."""

    noise_ratio: float  # residual of the link errors alone over the declared noise
    confounded: bool  # whether effects stayed confounded


@dataclass(frozen=True)
class FromFit(Brief):
    """Start from a calibration; the next poses are measured from its last scanner station or a new one."""

    calibration: Calibration
    base_T_scanner: Array | None = None  # (4, 4) pose of the scanner at a new station; None: the last one
    diagnosed: DiagnosedModel | None = None  # where a diagnosis chose the calibration's model

    @property
    def dataset(self) -> Dataset:
        """Dataset of the calibration."""
        return self.calibration.dataset

    @property
    def measured(self) -> Poses:
        """Measured poses, test poses included."""
        return self.calibration.dataset.poses

    @property
    def setup(self) -> str:
        """Name of the scanner's last station, or a free name for a new one."""
        if self.base_T_scanner is None:
            return self._last_setup
        names = set(map(str, self.measured.setup))
        number = 1
        while (name := NEW_SETUP if number == 1 else f"{NEW_SETUP}{number}") in names:
            number += 1
        return name

    @property
    def _last_setup(self) -> str:
        """Name of the scanner station of the training pose that was measured last."""
        poses, points = self.calibration.fitted_dataset.poses, self.calibration.fitted_dataset.points
        assert points is not None
        trained = points.pose[~poses.is_test[points.pose]]
        return str(poses.setup[trained[np.argmax(poses.order[trained])]])

    @cached_property
    def cell(self) -> Workcell:
        """Cell with the fitted robot, and the scanner placed by the fit or at the new station."""
        last = self._last_setup
        fitted = replace(self.dataset, robot=self.calibration.robot)
        placed = frames.invert(self.calibration.after.scanner_T_base[last])
        cell = workcell_of_dataset(fitted, parent_T_scanner=placed, setup=last)
        return cell if self.base_T_scanner is None else replace(cell, base_T_scanner=self.base_T_scanner)

    def unknowns(self, effects: Sequence[Effect] = ()) -> Unknowns:
        """Unknowns of the fit, including the coefficients of further effects."""
        return self._unknowns_with(effects) if effects else self._unknowns

    @cached_property
    def _unknowns(self) -> Unknowns:
        """Unknowns of the fit alone, cached because a plan asks for them several times."""
        return self._unknowns_with(())

    def _unknowns_with(self, effects: Sequence[Effect]) -> Unknowns:
        """Unknowns of the fit, the coefficients of further effects, and the frame of a new station."""
        new_station = None if self.base_T_scanner is None else {self.setup: frames.invert(self.base_T_scanner)}
        return unknowns_of_fit(self.calibration, effects=effects, scanner_T_base=new_station)

    def poses_at(self, q: Array) -> Poses:
        """Training poses at joints q (N, n), with conditions of the measured poses, as at the latest time."""
        poses, time_s = conditions_at(self.measured, q), self.measured.time_s
        later = None if time_s is None else np.full(len(q), time_s.max())
        return replace(poses, role=np.full(len(q), "train"), setup=np.full(len(q), self.setup), time_s=later)

    def missed_mm2(self, poses: Poses) -> float:
        """Mean square 3D error, mm^2, that the fit's left-out poses show it to miss at given poses."""
        return 3.0 * float(np.mean(missed_variance(self.calibration, poses.q)))


@dataclass(frozen=True)
class FromRobot:
    """Start from an arm that was never measured, for a first set of poses."""

    cell: Workcell  # with the scanner roughly where it will stand
    noise_mm: float = DEFAULT_NOISE_MM  # sigma per coordinate of a measured point
    options: FitOptions = field(default_factory=FitOptions)

    @property
    def dataset(self) -> Dataset:
        """Dataset with the robot and without poses."""
        robot = self.cell.robot
        return Dataset(robot.name, robot, self.poses_at(np.zeros((0, robot.n_joints))))

    @property
    def measured(self) -> None:
        """None, as nothing was measured."""
        return None

    @property
    def setup(self) -> str:
        """Empty name of the only scanner station."""
        return ""

    def unknowns(self, effects: Sequence[Effect] = ()) -> Unknowns:
        """Unknowns of a first fit: parameters within tolerances, and coefficients of further effects."""
        if not self.options.prior:
            raise CalibError("a first set of poses is planned with tolerances; leave out --no-prior")
        base_T_scanner = np.eye(4) if self.cell.base_T_scanner is None else self.cell.base_T_scanner
        return unknowns_of_robot(
            self.cell.robot,
            base_T_scanner,
            noise_mm=self.noise_mm,
            effects=effects,
            tolerances=self.options.tolerances,
            fixed=self.options.fixed,
        )

    def poses_at(self, q: Array) -> Poses:
        """Training poses at joints q (N, n), named q1, q2, ..."""
        n = len(q)
        ids = tuple(f"q{i + 1}" for i in range(n))
        return Poses(ids, np.full(n, "train"), q, np.full(n, ""), ids)

    def missed_mm2(self, poses: Poses) -> float:
        """Zero, as nothing shows yet what a model of the arm will miss."""
        return 0.0


def start_of_dataset(
    dataset: Dataset,
    options: FitOptions,
    *,
    effects: Sequence[Effect] = (),
    user_effects: Sequence[Family] = (),
    base_T_scanner: Array | None = None,
    on_step: Callable[[str], None] | None = None,
) -> FromFit:
    """Start from the fit of a dataset, or from its diagnosis where the residual is above the declared noise.

    Poses that stand out are left out, as a diagnosis does.

    Args:
        dataset: measured poses with their points.
        options: options of the fit.
        effects: effects that the model has; the diagnosis is then left out.
        user_effects: families beyond the catalogue.
        base_T_scanner: (4, 4) pose of the scanner for the new poses, where it is set up anew.
        on_step: called with a line of text before each stage of a diagnosis.

    Raises FitError where lengths were measured, or a scanner on the flange is to be set up in the room.
    """
    require_points(dataset)
    if base_T_scanner is not None:
        require_scanner_in_room(dataset)
    calibration = without_blunders(fit_measured(dataset, options, effects=effects))
    check = check_sigma(calibration)
    if effects or check.verdict != "excess" or not check.declared_mm:
        return FromFit(calibration, base_T_scanner)
    diagnosis = whole_diagnosis(SearchSpace.of(dataset, options, user_effects=user_effects), on_step)
    diagnosed = DiagnosedModel(check.sigma_mm / check.declared_mm, diagnosis.verdict == "ambiguous")
    return FromFit(diagnosis.calibration, base_T_scanner, diagnosed)
