"""Result of a calibration: the fitted model, the options of the fit, and the errors at the measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.brief import Brief, errors_in_short
from calib.calibration.evaluation import Evaluation, evaluate_all
from calib.calibration.orientation_errors import OrientationErrors, evaluate_orientations
from calib.compensation.correction import Correction, Corrects
from calib.dataset.dataset import Dataset, FaceLabelling, Poses
from calib.dataset.repeats import RepeatCount, without_poses
from calib.dataset.trained_range import TrainedRange
from calib.errors import FitError
from calib.fitting.fit import Fit
from calib.fitting.model import Model
from calib.fitting.observations import Observations, observed_hand_eye
from calib.fitting.tool_point import ToolShift, tool_shift
from calib.kinematics.cartesian import require_links
from calib.kinematics.robot import PARAMETER_KINDS, TOOL_POINT, Robot
from calib.lazy_modules import pd
from calib.options import FitOptions
from calib.plugins import load
from calib.presented import Presented
from calib.statistics import axis_sigma, rms


@dataclass(frozen=True)
class IterationErrors:
    """RMS of 3D and of distance errors at one iteration, mm; nan for test poses where there are none."""

    train_rmse_mm: float = field(metadata={"key": "rmse_mm"})
    test_rmse_mm: float
    train_distance_rmse_mm: float = field(metadata={"key": "distance_rmse_mm"})
    test_distance_rmse_mm: float


class PortableModel(Corrects, Protocol):
    """What a result gives of itself without its measurements: a `calib.FittedModel`."""

    @property
    def covariance(self) -> Array:
        """Covariance (P, P) of the free parameters."""
        ...

    def predict(self, q: ArrayLike, conditions: Poses | None = None, target: str = TOOL_POINT) -> Array:
        """A target's position (N, 3), mm in the base frame, at joint vectors (N, n)."""
        ...

    def save(self, path: str | Path) -> None:
        """Write the model as model.json."""
        ...

    def to_json(self) -> str:
        """Content of model.json."""
        ...


class FittedResult:
    """Base of results that hold a fitted model: access to parameters, prediction, correction and files.

    Models as files and corrections stand above calibrations, whose values they take, and are loaded by name when a
    result is asked for them.
    """

    @property
    def calibration(self) -> Calibration:
        """Calibration that the result holds."""
        raise NotImplementedError

    @property
    def fitted_model(self) -> PortableModel:
        """Fitted model without the dataset, as `load_model` gives it: robot, effects, values, covariance."""
        model: PortableModel = load("calib.models.fitted_model:FittedModel").of(self.calibration)
        return model

    @property
    def parameters(self) -> pd.DataFrame:
        """Table with one row per free parameter: name, nominal, value, change, sigma, tolerance, unit, known."""
        return self.calibration.to_frame()

    @property
    def covariance(self) -> Array:
        """Covariance (P, P) of the free parameters, with zero rows for parameters that nothing determines."""
        return self.fitted_model.covariance

    @property
    def robot(self) -> Robot:
        """Robot with the fitted table, which is right only together with the model's effects, if it has any."""
        return self.calibration.model.calibrated_robot(self.calibration.fit.x)

    def predict(self, q: ArrayLike, conditions: Poses | None = None, target: str = TOOL_POINT) -> Array:
        """A target's position (N, 3), mm in the base frame, at joint vectors q (N, n), rad or mm.

        Args:
            q: joint vectors.
            conditions: payload, temperature ... of each, where the model depends on them; its own q is not used.
            target: one of the robot's targets; "jig" is the measured point of the tool.

        Raises:
            FitError: missing conditions, q of another shape, or an unknown target.
        """
        return self.fitted_model.predict(q, conditions, target)

    def correct(
        self,
        q_nominal: ArrayLike,
        conditions: Poses | None = None,
        kind: str | None = None,
        nominal: Robot | None = None,
        ids: Sequence[str] | None = None,
    ) -> Correction:
        """Joint vectors with which the calibrated arm goes where the nominal one would (`calib.corrected_joints`)."""
        return self.fitted_model.correct(q_nominal, conditions, kind, nominal, ids)

    def save(self, path: str | Path) -> None:
        """Write the fitted model as model.json, which `calib.load_model` reads."""
        self.fitted_model.save(path)

    def save_robot(self, path: str | Path, template: str | Path | None = None, *, force: bool = False) -> None:
        """Write the calibrated robot as a file, with the table that fits best without any effect.

        Args:
            path: ends in .toml, .urdf or .yaml.
            template: the user's own file of this arm; its origins are replaced and all else stays.
            force: write also where the fit is no improvement.

        Raises:
            FitError: the fit did not converge or is worse on the test poses.
            CalibError: another suffix, or a template that is of another arm.
        """
        table = load("calib.models.exported_table:exported_table")(self.calibration)
        table.require_improvement(force=force)
        table.save(path, template)


@dataclass(frozen=True)
class Worsening(Brief):
    """Rise of the 3D RMSE caused by a fit, compared with the arm as delivered."""

    role: str  # of the poses: "test" or "train"
    before_mm: float
    after_mm: float


@dataclass(frozen=True, eq=False)
class Calibration(FittedResult, Presented):
    """A fitted model with its dataset, options, fit, and errors at the measurements before and after."""

    dataset: Dataset
    model: Model
    options: FitOptions  # what was asked of the fit
    fit: Fit
    before: Evaluation
    after: Evaluation
    outliers: tuple[str, ...] = ()  # ids of poses that a robust fit left out
    averaged: Dataset | None = None  # one point for each stand and target, where that is not the dataset itself

    @cached_property
    def fitted_dataset(self) -> Dataset:
        """Dataset used for the fit, in which each repeat group is replaced by the mean of its repeats.

        Without the points of outlying poses.
        """
        dataset = self.averaged or self.dataset
        return without_poses(dataset, self.outliers) if self.outliers else dataset

    @property
    def repeat_count(self) -> RepeatCount | None:
        """Number of measured points and repeat groups; None where no pose was measured several times."""
        return None if self.averaged is None else RepeatCount.of(self.dataset)

    @property
    def residual(self) -> str:
        """Kind of the minimised residual, one of `calib.options.RESIDUAL_KINDS`."""
        return self.options.residual

    @property
    def calibration(self) -> Calibration:
        """This calibration, for the interface of `FittedResult`."""
        return self

    @cached_property
    def fitted_model(self) -> PortableModel:
        """Fitted model without the dataset, as `load_model` gives it: robot, effects, values, covariance."""
        return super().fitted_model

    @cached_property
    def iteration_errors(self) -> tuple[IterationErrors, ...]:
        """Errors at each iteration, the first being the nominal robot; computed when first read."""
        xs = [iteration.x for iteration in self.fit.iterations]
        at = evaluate_all(self.model, xs, self.dataset, self.outliers)
        return tuple(_iteration_errors(evaluation) for evaluation in at)

    @cached_property
    def orientation_errors(self) -> tuple[OrientationErrors, OrientationErrors] | None:
        """Orientation errors before and after; None where orientations were not fitted."""
        if self.residual != "pose":
            return None
        before, after = (
            evaluate_orientations(self.model, x, self.dataset) for x in (self.model.delivered(self.fit.x), self.fit.x)
        )
        return before, after

    @property
    def face_labelling(self) -> FaceLabelling | None:
        """Labelling of the jig's faces; None unless full poses from scans were fitted."""
        points = self.dataset.points
        orientations = None if points is None else points.orientations
        return orientations.labelling if self.residual == "pose" and orientations is not None else None

    @cached_property
    def trained(self) -> TrainedRange:
        """Range of each joint over the fitted poses."""
        return TrainedRange.of(self.dataset, self.outliers)

    @property
    def outside(self) -> tuple[str, ...]:
        """Names of the measured poses whose joints leave the trained ranges."""
        poses = self.dataset.poses
        beyond = self.trained.outside(self.dataset.robot, poses.q)
        measured = self.after.pose
        return tuple(poses.ids[i] for i in np.flatnonzero(beyond) if i in measured)

    @property
    def links_fixed_to_table(self) -> bool:
        """Whether the links are held as robot.toml has them, because the points show that they have no errors."""
        return self.model.robot.parameter_names[0] in self.model.prior_sigmas

    @property
    def fits_links(self) -> bool:
        """Whether any parameter of the arm's own links was free, those of the tool apart."""
        names = self.model.robot.parameter_names[: -len(PARAMETER_KINDS)]
        return not set(names) <= set(self.options.fixed)

    @property
    def tool_shift(self) -> ToolShift | None:
        """Shift of the tool point, where this is far from robot.toml's and that has one; else None."""
        told = self.model.tool_found is not None and not self.dataset.robot.is_cartesian
        return tool_shift(self.dataset.robot, self.robot) if told else None

    @cached_property
    def undetermined_shifts(self) -> Array:
        """Directions (K, 3), base frame, along which a scanner on the flange and its targets may shift together."""
        if not self.model.robot.carries_scanner:
            return np.zeros((0, 3))
        return observed_hand_eye(self.dataset.robot, Observations.of(self.fitted_dataset)).undetermined_shifts

    @property
    def sigma_mm(self) -> float:
        """Residual sigma per coordinate of a point, mm, corrected for degrees of freedom; nan where none are left."""
        return self.fit.reduced_chi * declared_sigma_mm(self.fitted_dataset)

    @property
    def worsening(self) -> Worsening | None:
        """Rise of the test poses' error by the fit (training poses' without test poses); None without a rise.

        The training error can rise in a fit of distances, or without a prior. With the links held as in robot.toml
        nothing of the arm changes, and a rise is that of the instrument's frame.
        """
        if self.links_fixed_to_table or not self.fits_links:
            return None
        for role, before, after in (
            ("test", self.before.test, self.after.test),
            ("train", self.before.train, self.after.train),
        ):
            if before is not None and after is not None:
                rises = after.rmse_mm > before.rmse_mm
                return Worsening(role, before.rmse_mm, after.rmse_mm) if rises else None
        return None

    @property
    def outlier_errors_mm(self) -> dict[str, float]:
        """Largest 3D error, mm, at each pose that a robust fit left out, by pose id."""
        after, poses = self.after, self.dataset.poses
        length_mm = np.linalg.norm(after.error_mm, axis=1)
        return {name: float(np.max(length_mm[after.pose == poses.index(name)])) for name in self.outliers}

    def require_improvement(self, *, force: bool = False) -> None:
        """Raise FitError if the fit should not go on a robot: not converged, worse than delivered, or no links."""
        require_links(self.dataset.robot, "a calibrated robot")
        if force:
            return
        way_out = "find out why before you use it, or force it"
        if not self.fit.converged:
            raise FitError(f"dataset {self.dataset.name}: the fit did not converge ({self.fit.reason}); {way_out}")
        before, after = self.before.test, self.after.test
        if before is not None and after is not None and after.rmse_mm >= before.rmse_mm:
            raise FitError(
                f"dataset {self.dataset.name}: the test poses got worse, RMSE from {before.rmse_mm:.4g} to "
                f"{after.rmse_mm:.4g} mm; {way_out}"
            )

    def to_frame(self) -> pd.DataFrame:
        """Table with one row per free parameter: name, nominal, value, change, sigma, tolerance, unit, known.

        A parameter is known where its sigma is below half of its tolerance.
        """
        return pd.DataFrame(self._parameter_columns())

    def parameter_rows(self) -> list[dict[str, Any]]:
        """The rows of `to_frame`, each by column."""
        columns = self._parameter_columns()
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]

    def _parameter_columns(self) -> dict[str, list[Any]]:
        parameters, x = self.fit.parameters, self.fit.x.tolist()
        return {
            "name": [p.name for p in parameters],
            "nominal": [p.nominal for p in parameters],
            "value": [p.nominal + v for p, v in zip(parameters, x, strict=True)],
            "change": x,
            "sigma": self.fit.sigma.tolist(),
            "tolerance": [p.scale for p in parameters],
            "unit": [p.unit for p in parameters],
            "known": (self.fit.sigma < 0.5 * self.model.scales).tolist(),
        }

    def _brief(self) -> str:
        effects = ", ".join(self.model.family_names) or "none"
        errors = errors_in_short(self.before, self.after)
        return f"{self.dataset.name}: {len(self.dataset.poses)} poses, {errors}, effects: {effects}"


def times_declared_noise(calibration: Calibration) -> float | None:
    """Residual of a fit over the noise that dataset.toml declares; None where it declares none."""
    ratio = calibration.fit.reduced_chi
    return float(ratio) if calibration.dataset.declares_noise and np.isfinite(ratio) else None


def declared_sigma_mm(dataset: Dataset) -> float:
    """Declared sigma per coordinate, mm, RMS over the measured points."""
    return axis_sigma(Observations.of(dataset).covariance_mm2)


def _iteration_errors(evaluation: Evaluation) -> IterationErrors:
    def rms_or_nan(values: Array) -> float:
        return rms(values) if len(values) else float("nan")

    of_train = ~evaluation.is_test[evaluation.distance_pose]
    of_test = evaluation.is_tested[evaluation.distance_pose]
    return IterationErrors(
        evaluation.train_rmse_mm,
        evaluation.test_rmse_mm,
        rms_or_nan(evaluation.distance_error_mm[of_train]),
        rms_or_nan(evaluation.distance_error_mm[of_test]),
    )
