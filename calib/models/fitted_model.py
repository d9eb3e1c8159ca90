"""A fitted model by itself: robot, effects, fitted values and what is known of them, without the measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.calibration.evaluation import Evaluation, Figures, evaluate_all
from calib.calibration.result import Calibration
from calib.compensation.attitude import FitKnowledge
from calib.compensation.target_correction import Correction, corrected_joints, needed_columns, plain_poses
from calib.dataset.dataset import Dataset, Poses
from calib.dataset.files.fingerprint import fingerprint
from calib.dataset.input_names import CONDITIONS, quantity_of
from calib.dataset.stands import without_poses
from calib.dataset.trained_range import TrainedRange
from calib.errors import FitError
from calib.fitting.model import Model
from calib.kinematics.robot import Robot
from calib.options import FitOptions
from calib.presented import Presented

PROGRAM = "robot-calibration-inspector"
_SAME_TABLE = 1e-9  # mm or rad


@dataclass(frozen=True)
class RoleErrors:
    """Errors of the training poses and of the test poses; None where there are none."""

    train: Figures | None
    test: Figures | None


@dataclass(frozen=True)
class Source:
    """Where a model comes from."""

    dataset: str  # its name
    files: Mapping[str, str]  # hash by file name; empty for a dataset that lies in no folder
    training_poses: tuple[str, ...]  # ids of the poses that the fit saw
    program_version: str
    left_out: tuple[str, ...] = ()  # ids of poses that it did not see, as asked or because they stand out


@dataclass(frozen=True)
class FittedModel(Presented):
    """A model at its fitted values, which predicts and corrects without a refit. P free parameters."""

    model: Model
    x: Array  # (P,) corrections in the parameters' units
    covariance: Array  # (P, P); rows of parameters without a bound are zero
    sigma: Array  # (P,) inf where nothing bounds the parameter
    options: FitOptions
    scanner_T_base: Mapping[str, Array]
    """(4, 4) by setup, as the training poses place the scanner; scanner_T_flange where the arm carries it"""
    needs: tuple[str, ...]  # columns of poses.csv that a prediction depends on, besides the joints
    before: RoleErrors  # of the nominal robot
    after: RoleErrors
    sigma_mm: float  # residual of one coordinate; nan without degrees of freedom
    source: Source
    trained: TrainedRange | None = None  # of the joints; None in a file that does not say it

    @classmethod
    def of(cls, calibration: Calibration) -> FittedModel:
        """The model of a calibration."""
        dataset, fit = calibration.dataset, calibration.fit
        bounded = ~fit.undetermined
        return cls(
            model=calibration.model,
            x=fit.x,
            covariance=np.where(np.outer(bounded, bounded), fit.covariance, 0.0),
            sigma=fit.sigma,
            options=calibration.options,
            scanner_T_base=calibration.after.scanner_T_base,
            needs=needed_columns(calibration.model, fit.x, dataset.poses),
            before=RoleErrors(calibration.before.train, calibration.before.test),
            after=RoleErrors(calibration.after.train, calibration.after.test),
            sigma_mm=calibration.sigma_mm,
            source=_source(dataset, calibration.outliers),
            trained=calibration.trained,
        )

    @property
    def robot(self) -> Robot:
        """The robot with the fitted table: right only together with the effects."""
        return self.model.calibrated_robot(self.x)

    def predict(self, q: ArrayLike, conditions: Poses | None = None, target: str = "jig") -> Array:
        """A target's position (N, 3), mm in the base frame, at joint vectors q (N, n), rad or mm; "jig" is the tool.

        `conditions`: payload, temperature ... of each, where the model depends on them; its own q is not used.
        Raises FitError where they are missing, for q of another shape, or for an unknown target.
        """
        q = np.array(q, dtype=float)
        joints = self.model.robot.n_joints
        if q.ndim != 2 or q.shape[1] != joints:
            raise FitError(f"joint vectors for {self.model.robot.name} have shape (N, {joints}), found {q.shape}")
        targets = ("jig", *(known.name for known in self.model.robot.targets if not known.in_room))
        if target not in targets:
            raise FitError(f"no target named {target!r}; there are {', '.join(targets)}")
        self.require_conditions(conditions)
        if conditions is not None and len(conditions) != len(q):
            raise FitError(f"found conditions of {len(conditions)} poses for {len(q)} joint vectors")
        poses = plain_poses(q) if conditions is None else replace(conditions, q=q)
        return self.model.at_tool.predict(self.x, poses, target)

    def corrected_joints(
        self,
        q_nominal: ArrayLike,
        conditions: Poses | None = None,
        what: str | None = None,
        nominal: Robot | None = None,
        ids: Sequence[str] | None = None,
    ) -> Correction:
        """`calib.corrected_joints` for this model: joint vectors with which the arm goes where the nominal one would.

        `nominal`: the robot that the controller computes with, where not the one that was fitted. Raises FitError.
        """
        self.require_conditions(conditions)
        robot = nominal or self.model.robot
        open_ended = np.where(np.isfinite(self.sigma), 0.0, self.model.scales**2)
        covariance = self.covariance + np.diag(open_ended)  # what no point tells is known by its tolerance alone
        full_poses = self.options.residual == "pose"
        known = FitKnowledge(covariance, frozenset(self.options.held), full_poses, self.trained)
        return corrected_joints(
            robot, self.model, q_nominal, x=self.x, conditions=conditions, what=what, known=known, ids=ids
        )

    def evaluate(self, dataset: Dataset) -> Evaluation:
        """Hold the model, as it is, against a dataset's points; raises as `before_and_after`."""
        return self.before_and_after(dataset)[1]

    def before_and_after(self, dataset: Dataset) -> tuple[Evaluation, Evaluation]:
        """The errors of the arm as delivered at a dataset's points, and the model's, as it is.

        Each setup's scanner frame is fitted to the setup's training poses, as in every evaluation; nothing else is. The
        poses of another dataset than the model was fitted to count as later than all of that one's.

        Raises FitError for another arm, unknown targets, or missing conditions.
        """
        self.require_same_arm(dataset)
        if dataset.points is not None:
            in_room = self.model.robot.carries_scanner
            on_arm = set() if in_room else {"jig"}
            known = on_arm | {target.name for target in self.model.robot.targets if target.in_room == in_room}
            unknown = sorted(set(map(str, np.unique(dataset.points.target))) - known)
            if unknown:
                raise FitError(f"dataset {dataset.name}: the model has no target {unknown[0]!r}")
        self.require_conditions(dataset.poses)
        if self.source.files and not self.is_fitted_to(dataset):  # another day: what changed has changed
            dataset = replace(dataset, poses=dataset.poses.measured_later())
        before, after = evaluate_all(self.model, [self.model.delivered(self.x), self.x], dataset)
        return before, after

    def require_same_arm(self, dataset: Dataset) -> None:
        """Raise FitError where a dataset's nominal robot is not the one that the model corrects."""
        mine, other = self.model.robot, dataset.robot
        if not np.array_equal(mine.is_revolute, other.is_revolute):
            raise FitError(
                f"dataset {dataset.name}: its robot has {other.n_joints} joints, the model's {mine.n_joints}, or their "
                "kinds differ; the model is of another arm"
            )
        if mine.carries_scanner != other.carries_scanner:
            raise FitError(
                f"dataset {dataset.name}: [scanner] mount in its dataset.toml is not that of the model's dataset; a "
                "model predicts for the scanner where it was"
            )
        if mine.coupling != other.coupling:
            raise FitError(
                f"dataset {dataset.name}: coupling in its robot.toml is not the model's; the model is of another arm"
            )
        if np.abs(mine.base_T_first - other.base_T_first).max() > _SAME_TABLE:
            raise FitError(
                f"dataset {dataset.name}: [base] in its robot.toml is not the model's; the two have to be one"
            )
        off = np.abs(mine.table - other.table) > _SAME_TABLE
        if off.any():
            name = mine.parameter_names[int(np.flatnonzero(off)[0])]
            raise FitError(
                f"dataset {dataset.name}: {name} in its robot.toml is not that of the model's nominal table; the model "
                "is of another arm or another tool"
            )

    def require_conditions(self, conditions: Poses | None) -> None:
        """Raise FitError where poses lack what the model's effects depend on."""
        missing = [name for name in self.needs if conditions is None or not _has(conditions, name)]
        if missing:
            raise FitError(
                f"the model depends on {', '.join(missing)} through its effects "
                f"({', '.join(self.model.family_names)}); give it for each pose, as poses.csv does"
            )

    def outside(self, dataset: Dataset) -> tuple[str, ...] | None:
        """The poses of a dataset whose joints leave the ranges that were trained; None where the model has none."""
        if self.trained is None:
            return None
        beyond = self.trained.outside(self.model.robot, dataset.poses.q)
        return tuple(dataset.poses.ids[i] for i in np.flatnonzero(beyond))

    def is_fitted_to(self, dataset: Dataset) -> bool:
        """Whether the files of a dataset are those that the model was fitted to."""
        return bool(self.source.files) and dict(self.source.files) == fingerprint(dataset)


def program_version() -> str:
    """The version of this program."""
    return version(PROGRAM)


def _source(dataset: Dataset, outliers: tuple[str, ...]) -> Source:
    fitted = without_poses(dataset, outliers) if outliers else dataset
    points = fitted.points
    assert points is not None
    seen = np.unique(points.pose[~dataset.poses.is_test[points.pose]])
    files = {} if dataset.folder is None else fingerprint(dataset)
    return Source(dataset.name, files, tuple(dataset.poses.ids[i] for i in seen), program_version(), fitted.left_out)


def _has(poses: Poses, column: str) -> bool:
    if column in CONDITIONS:
        return getattr(poses, column) is not None
    if quantity_of(column) == "approach" and poses.approach is not None:
        return True
    return column in poses.extra.columns
