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
    unknowns_of_fit,
    unknowns_of_robot,
)
from calib.screening.blunders import without_blunders
from calib.workcell.candidates import candidate_poses
from calib.workcell.known_cell import workcell_of_dataset
from calib.workcell.workcell import Workcell


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
    """Start from a calibration; the next poses are measured from its last scanner station."""

    calibration: Calibration
    diagnosed: DiagnosedModel | None = None  # where a diagnosis chose the calibration's model

    @property
    def dataset(self) -> Dataset:
        """Dataset of the calibration."""
        return self.calibration.dataset

    @property
    def measured(self) -> Poses:
        """Measured poses, test poses included."""
        return self.calibration.dataset.poses

    @cached_property
    def setup(self) -> str:
        """Name of the scanner station of the training pose that was measured last."""
        poses, points = self.calibration.fitted_dataset.poses, self.calibration.fitted_dataset.points
        assert points is not None
        trained = points.pose[~poses.is_test[points.pose]]
        return str(poses.setup[trained[np.argmax(poses.order[trained])]])

    @cached_property
    def cell(self) -> Workcell:
        """Cell with the fitted robot, and the scanner placed by the fit."""
        fitted = replace(self.dataset, robot=self.calibration.robot)
        placed = frames.invert(self.calibration.after.scanner_T_base[self.setup])
        return workcell_of_dataset(fitted, parent_T_scanner=placed, setup=self.setup)

    def unknowns(self, effects: Sequence[Effect] = ()) -> Unknowns:
        """Unknowns of the fit, including the coefficients of further effects."""
        return unknowns_of_fit(self.calibration, effects=effects) if effects else self._unknowns

    @cached_property
    def _unknowns(self) -> Unknowns:
        """Unknowns of the fit alone, cached because a plan asks for them several times."""
        return unknowns_of_fit(self.calibration)

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
    on_step: Callable[[str], None] | None = None,
) -> FromFit:
    """Start from the fit of a dataset, or from its diagnosis where the residual is above the declared noise.

    Poses that stand out are left out, as a diagnosis does.

    Args:
        dataset: measured poses with their points.
        options: options of the fit.
        effects: effects that the model has; the diagnosis is then left out.
        user_effects: families beyond the catalogue.
        on_step: called with a line of text before each stage of a diagnosis.

    Raises FitError where lengths were measured.
    """
    require_points(dataset)
    calibration = without_blunders(fit_measured(dataset, options, effects=effects))
    check = check_sigma(calibration)
    if effects or check.verdict != "excess" or not check.declared_mm:
        return FromFit(calibration)
    diagnosis = whole_diagnosis(SearchSpace.of(dataset, options, user_effects=user_effects), on_step)
    diagnosed = DiagnosedModel(check.sigma_mm / check.declared_mm, diagnosis.verdict == "ambiguous")
    return FromFit(diagnosis.calibration, diagnosed)


OFFERED = 400


def offered_poses(calibration: Calibration, *, count: int = OFFERED) -> Poses:
    """Candidate poses that can be measured next from the scanner's first station.

    Where no such pose is found, they lie within the ranges of the measured joints.
    """
    rng = np.random.default_rng(0)
    dataset = calibration.dataset
    measured = dataset.poses
    setup, scanner_T_base = next(iter(calibration.after.scanner_T_base.items()))
    try:
        cell = workcell_of_dataset(dataset, parent_T_scanner=frames.invert(scanner_T_base), setup=setup)
        q = candidate_poses(cell, count, rng=rng)
    except CalibError:
        q = rng.uniform(measured.q.min(axis=0), measured.q.max(axis=0), (count, measured.q.shape[1]))
    poses = conditions_at(measured, q)
    offered = replace(poses, role=np.full(count, "train"), setup=np.full(count, setup))
    return under_conditions(offered, measured)


def under_conditions(poses: Poses, measured: Poses, payloads_kg: tuple[float, ...] = ()) -> Poses:
    """Poses with payload, temperature and approach drawn from the range of the measured poses.

    Payload and temperature are at either end of their range, and each joint is approached from either side, where that
    was recorded.

    Args:
        poses: to be measured.
        measured: poses whose conditions vary as the new ones shall.
        payloads_kg: payloads to draw from, where that of the measured poses does not vary.
    """
    rng = np.random.default_rng(0)
    payload_kg, temperature_c = (
        rng.choice(ends, len(poses)) if ends else None
        for ends in (_ends(measured.payload_kg) or payloads_kg, _ends(measured.temperature_c))
    )
    return replace(
        poses,
        payload_kg=poses.payload_kg if payload_kg is None else payload_kg,
        temperature_c=poses.temperature_c if temperature_c is None else temperature_c,
        approach=None if measured.approach is None else rng.choice([-1.0, 1.0], poses.q.shape),
    )


def _ends(values: Array | None) -> tuple[float, ...]:
    """Least and largest value of a pose condition (such as payload); () where it does not vary."""
    if values is None or not np.ptp(values) > 0.0:
        return ()
    return float(values.min()), float(values.max())
