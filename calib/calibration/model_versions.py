"""Versions of a model for comparison: as delivered, with calibrated links, with effects."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.calibrate import fit_measured
from calib.calibration.evaluation import Evaluation, scanner_T_base_of_points, scanner_T_base_of_poses
from calib.calibration.result import Calibration
from calib.fitting.model import Model, geometric_model
from calib.fitting.observations import Observations, with_observed_targets
from calib.fitting.tool_point import tool_point_in_nominal
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import with_own_tool_point
from calib.options import FitOptions
from calib.statistics import group_means

NOMINAL, LINKS, EFFECTS = "as delivered", "calibrated links", "with effects"
VERSIONS = (NOMINAL, LINKS, EFFECTS)


def model_name(model: Model) -> str:
    """Name of a fitted model by its content: "calibrated links + backlash"."""
    return " + ".join([LINKS, *model.family_names])


@dataclass(frozen=True)
class Version:
    """A version of the model with its errors at all measured points of the dataset."""

    name: str  # of VERSIONS
    model: Model
    x: Array  # (P,)
    evaluation: Evaluation
    calibration: Calibration

    def pose_errors_mm(self) -> Array:
        """RMS (N,) of the 3D errors of each pose's points, mm; nan where nothing was measured."""
        squared = np.sum(self.evaluation.error_mm**2, axis=1)
        return np.sqrt(self._mean_by_pose(squared))

    def pose_error_vectors_mm(self) -> Array:
        """Mean error (N, 3) of each pose's points, predicted minus measured, mm, scanner frame; nan without points."""
        return self._mean_by_pose(self.evaluation.error_mm)

    @cached_property
    def scanner_T_base(self) -> Array:
        """Transforms scanner_T_base (N, 4, 4) at each pose; nan where not known."""
        poses = self.calibration.dataset.poses
        return scanner_T_base_of_poses(self.evaluation, self.model, self.x, poses)

    @cached_property
    def scanner_T_base_of_points(self) -> Array:
        """Transforms scanner_T_base (M, 4, 4) at each measured point."""
        return scanner_T_base_of_points(self.evaluation, self.model, self.x, self.calibration.dataset)

    def flange_T_scanner(self, pose: int) -> Array | None:
        """Transform flange_T_scanner (4, 4) at a pose; None where the arm does not carry the scanner."""
        setup = str(self.calibration.dataset.poses.setup[pose])
        placed = self.evaluation.scanner_T_base.get(setup)
        return frames.invert(placed) if self.model.robot.carries_scanner and placed is not None else None

    def _mean_by_pose(self, values: Array) -> Array:
        """Mean by pose (N, ...) of values by measured point (M, ...)."""
        poses = len(self.calibration.dataset.poses)
        return group_means(values, self.evaluation.pose, poses, empty=float("nan"))


def versions(calibration: Calibration, links: Calibration | None = None) -> tuple[Version, ...]:
    """Versions of a calibration's model: nominal robot, link errors alone and, where there are effects, the full fit.

    `links` is the fit of the link errors alone to the same points with the same options; made here where None.
    """
    nominal = geometric_model(as_delivered(calibration))
    at_zero = np.zeros(len(nominal.parameters))
    out = [Version(NOMINAL, nominal, at_zero, calibration.before, calibration)]
    if not calibration.model.family_names:
        return (*out, fitted_version(LINKS, calibration))
    if links is None or not fits_same_points(links, calibration):
        links = fit_measured(calibration.dataset, options_for_links(calibration))
    return (*out, fitted_version(LINKS, links), fitted_version(EFFECTS, calibration))


def as_delivered(calibration: Calibration) -> Robot:
    """Nominal robot of robot.toml, with the found tool point where robot.toml's is far off.

    Targets in the room that robot.toml does not place, which an instrument on the flange saw, are where the fit began.
    """
    robot = with_observed_targets(calibration.dataset.robot, Observations.of(calibration.fitted_dataset))
    if calibration.model.tool_found is None:
        return robot
    return with_own_tool_point(robot, tool_point_in_nominal(robot, calibration.robot))


def fits_same_points(one: Calibration, other: Calibration) -> bool:
    """Whether two fits used the same measurements and the same options for the link errors."""
    a, b = one.dataset.points, other.dataset.points
    if options_for_links(one) != options_for_links(other):
        return False
    if one.dataset.robot != other.dataset.robot or a is None or b is None:
        return False
    return np.array_equal(a.pose, b.pose) and np.array_equal(a.xyz_mm, b.xyz_mm)


def options_for_links(calibration: Calibration) -> FitOptions:
    """Options of a fit, without those for parameters other than the link errors."""
    return calibration.options.for_parameters(calibration.model.geometry_names)


def fitted_version(name: str, calibration: Calibration) -> Version:
    """Named version of the model, made from a fit."""
    return Version(name, calibration.model, calibration.fit.x, calibration.after, calibration)
