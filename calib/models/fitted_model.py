"""A fitted model on its own: robot, effects, fitted values and their uncertainty, without the measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.brief import Brief, errors_in_short
from calib.calibration.evaluation import Evaluation, evaluate_all
from calib.calibration.promise import FitUncertainty, PointPromise, fit_uncertainty, promised_at_points
from calib.calibration.result import Calibration, declared_sigma_mm
from calib.compensation.attitude import FitKnowledge
from calib.compensation.correction import Correction
from calib.compensation.target_correction import correction_of, needed_columns, plain_poses, require_joint_vectors
from calib.dataset.dataset import Dataset, Poses
from calib.dataset.files.atomic_write import write_text_atomically
from calib.dataset.files.fingerprint import fingerprint
from calib.dataset.files.origin import Origin
from calib.dataset.input_names import CONDITIONS, quantity_of
from calib.dataset.repeats import without_poses
from calib.dataset.trained_range import TrainedRange
from calib.errors import FitError
from calib.fitting.discrepancy import Discrepancy
from calib.fitting.model import Model
from calib.kinematics.robot import TOOL_POINT, Robot
from calib.kinematics.tool_point import tool_point_of
from calib.lazy_modules import pd
from calib.models.effect_fields import member_document
from calib.models.model_document import KIND, VERSION, RoleErrors, options_document
from calib.options import FitOptions
from calib.presented import Presented
from calib.strict_json import to_json

_SAME_TABLE = 1e-9  # mm or rad


@dataclass(frozen=True)
class Source(Brief):
    """Dataset, poses and program version that a model was fitted with."""

    dataset: str  # its name
    training_poses: tuple[str, ...]  # ids of the poses that the fit saw
    origin: Origin
    left_out: tuple[str, ...] = ()  # ids of poses that it did not see, as asked or because they stand out


@dataclass(frozen=True)
class FittedModel(Presented):
    """A model with P fitted parameters, which predicts points and corrects targets without its dataset."""

    model: Model
    x: Array  # (P,) corrections in the parameters' units
    covariance: Array  # (P, P); rows of parameters without a bound are zero
    sigma: Array  # (P,) inf where nothing bounds the parameter
    options: FitOptions
    scanner_T_base: Mapping[str, Array]
    """Transform (4, 4) by setup, fitted to the training poses; scanner_T_flange where the arm carries the scanner."""
    needs: tuple[str, ...]  # columns of poses.csv that a prediction depends on, besides the joints
    before: RoleErrors  # of the nominal robot
    after: RoleErrors
    sigma_mm: float  # residual of one coordinate; nan without degrees of freedom
    source: Source
    trained: TrainedRange | None = None  # of the joints; None where a file has none
    discrepancy: Discrepancy | None = None  # what the model is known to miss; None where a file has none

    @classmethod
    def of(cls, calibration: Calibration) -> FittedModel:
        """The fitted model of a calibration, without its measurements."""
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
            discrepancy=fit_uncertainty(calibration).discrepancy,
        )

    @property
    def robot(self) -> Robot:
        """Robot with the fitted table, which is right only together with the model's effects, if it has any."""
        return self.model.calibrated_robot(self.x)

    @property
    def parameters(self) -> pd.DataFrame:
        """Table with one row per free parameter: name, nominal, value, change, sigma, tolerance, unit."""
        parameters = self.model.parameters
        return pd.DataFrame(
            {
                "name": [p.name for p in parameters],
                "nominal": [p.nominal for p in parameters],
                "value": [p.nominal + change for p, change in zip(parameters, self.x, strict=True)],
                "change": self.x,
                "sigma": self.sigma,
                "tolerance": [p.scale for p in parameters],
                "unit": [p.unit for p in parameters],
            }
        )

    def predict(self, q: ArrayLike, conditions: Poses | None = None, target: str = TOOL_POINT) -> Array:
        """A target's position (N, 3), mm in the base frame, at joint vectors q (N, n), rad or mm.

        `target`: "jig" is the measured point of the tool. `conditions`: payload, temperature ... of each joint vector,
        where the model depends on them; their own q is not used.
        Raises FitError where they are missing, for q of another shape or in degrees, or for an unknown target.
        """
        q = np.array(q, dtype=float)
        require_joint_vectors(self.model.robot, q, conditions)
        targets = (TOOL_POINT, *(known.name for known in self.model.robot.targets if not known.in_world))
        if target not in targets:
            raise FitError(f"no target named {target!r}; there are {', '.join(targets)}")
        self.require_conditions(conditions)
        poses = plain_poses(q) if conditions is None else replace(conditions, q=q)
        return self.model.at_tool.predict(self.x, poses, target)

    def correct(
        self,
        q_nominal: ArrayLike,
        conditions: Poses | None = None,
        kind: str | None = None,
        nominal: Robot | None = None,
        ids: Sequence[str] | None = None,
    ) -> Correction:
        """Joint vectors with which the calibrated arm goes where the nominal one would (`calib.corrected_joints`).

        `nominal`: the robot that the controller computes with, where it is not the one that was fitted.
        Raises FitError.
        """
        self.require_conditions(conditions)
        robot = nominal or self.model.robot
        open_ended = np.where(np.isfinite(self.sigma), 0.0, self.model.scales**2)
        covariance = self.covariance + np.diag(open_ended)  # parameters without a bound have their tolerance
        full_poses = self.options.residual == "pose"
        residual_mm = self.sigma_mm if np.isfinite(self.sigma_mm) else 0.0
        known = FitKnowledge(
            covariance, frozenset(self.options.fixed), full_poses, self.trained, residual_mm, self.discrepancy
        )
        return correction_of(
            robot, self.model, q_nominal, x=self.x, conditions=conditions, kind=kind, known=known, ids=ids
        )

    def evaluate(self, dataset: Dataset) -> Evaluation:
        """Errors of the model at a dataset's points. Raises FitError for another arm or missing columns."""
        return self.before_and_after(dataset)[1]

    def before_and_after(self, dataset: Dataset) -> tuple[Evaluation, Evaluation]:
        """Errors of the arm as delivered and of the model, at a dataset's points.

        Each setup's scanner frame is fitted to the setup's training poses, as in every evaluation; nothing else is
        fitted. Poses of another dataset than the model was fitted to count as measured after all of that one.

        Raises FitError for another arm, unknown targets, or missing conditions.
        """
        self.require_same_arm(dataset)
        if dataset.points is not None:
            in_world = self.model.robot.carries_scanner
            on_arm = set() if in_world else {TOOL_POINT}
            known = on_arm | {target.name for target in self.model.robot.targets if target.in_world == in_world}
            unknown = sorted(set(map(str, np.unique(dataset.points.target))) - known)
            if unknown:
                raise FitError(f"dataset {dataset.name}: the model has no target {unknown[0]!r}")
        self.require_conditions(dataset.poses)
        xs = [self.model.delivered(self.x), self.x]
        before, after = evaluate_all(self.model, xs, self.as_measured(dataset))
        return before, after

    def as_measured(self, dataset: Dataset) -> Dataset:
        """Dataset whose poses count as measured after those of the fit, unless it is the one that was fitted."""
        if self.source.origin.files and not self.is_fitted_to(dataset):  # another day: what changed has changed
            return replace(dataset, poses=dataset.poses.measured_later())
        return dataset

    def promise(self, dataset: Dataset, after: Evaluation) -> PointPromise:
        """Errors at a dataset's points (`evaluate`), each with the standard deviation promised for an unseen pose.

        The points' noise is that which the model's own fit left; a file without discrepancy promises without it.
        """
        ratio = self.sigma_mm / declared_sigma_mm(dataset) if np.isfinite(self.sigma_mm) else 1.0
        none = Discrepancy(0.0, 0.0, np.zeros((1, self.model.robot.n_joints)), np.ones(self.model.robot.n_joints))
        known = FitUncertainty(self.model, self.x, self.covariance, ratio, ratio, self.discrepancy or none)
        return promised_at_points(known, self.as_measured(dataset), after)

    def require_same_arm(self, dataset: Dataset) -> None:
        """Raise FitError where a dataset's nominal robot differs from the nominal robot of the model."""
        mine, other = self.model.robot, dataset.robot
        if not np.array_equal(mine.is_revolute, other.is_revolute):
            raise FitError(
                f"dataset {dataset.name}: its robot has {other.n_joints} joints, the model's {mine.n_joints}, or their "
                "kinds differ; the model is of another arm"
            )
        off = np.abs(mine.table - other.table) > _SAME_TABLE
        name = mine.parameter_names[int(np.flatnonzero(off)[0])] if off.any() else ""
        for what, differs, meaning in (
            (
                "[scanner] mount in its dataset.toml",
                mine.carries_scanner != other.carries_scanner,
                "a model predicts for the scanner where it was",
            ),
            ("coupling in its robot.toml", mine.coupling != other.coupling, "the model is of another arm"),
            (
                "[base] in its robot.toml",
                np.abs(mine.base_T_first - other.base_T_first).max() > _SAME_TABLE,
                "the two have to be one",
            ),
            (f"{name} in its robot.toml", off.any(), "the model is of another arm or another tool"),
        ):
            if differs:
                raise FitError(f"dataset {dataset.name}: {what} is not that of the model; {meaning}")

    def require_conditions(self, conditions: Poses | None) -> None:
        """Raise FitError where poses lack columns that the model's effects depend on."""
        missing = [name for name in self.needs if conditions is None or not _has(conditions, name)]
        if missing:
            raise FitError(
                f"the model depends on {', '.join(missing)} through its effects "
                f"({', '.join(self.model.family_names)}); give it for each pose, as poses.csv does"
            )

    def outside(self, dataset: Dataset) -> tuple[str, ...] | None:
        """Ids of the poses whose joints leave the trained ranges; None where the model's file has no ranges."""
        if self.trained is None:
            return None
        beyond = self.trained.outside(self.model.robot, dataset.poses.q)
        return tuple(dataset.poses.ids[i] for i in np.flatnonzero(beyond))

    def is_fitted_to(self, dataset: Dataset) -> bool:
        """Whether the model was fitted to exactly the files of a dataset."""
        files = self.source.origin.files
        return bool(files) and dataset.folder is not None and dict(files) == fingerprint(dataset)

    def save(self, path: str | Path) -> None:
        """Write the model as model.json, whole or not at all; `calib.load_model` reads it.

        Raises CalibError for a user's effect that cannot be saved.
        """
        write_text_atomically(Path(path), self.to_json())

    def to_json(self) -> str:
        """Content of model.json, one line per key (`model_document`)."""
        model, source = self.model, self.source
        loads, tool_found = model.loads_of, model.tool_found
        document = {
            "format": KIND,
            "version": VERSION,
            "program_version": source.origin.program_version,
            "origin": source.origin.document,
            "dataset": {
                "name": source.dataset,
                "files": source.origin.files,
                "training_poses": source.training_poses,
                "left_out": source.left_out,
            },
            "before": asdict(self.before),
            "after": asdict(self.after),
            "sigma_mm": self.sigma_mm,
            "options": options_document(self.options),
            "needs": self.needs,
            "robot": msgspec.to_builtins(model.robot),
            "table": self.robot.table,
            "loads_table": None if loads is None else loads.table,
            "found_tool_mm": None if tool_found is None else tool_point_of(tool_found),
            "trained": None if self.trained is None else asdict(self.trained),
            "discrepancy": None if self.discrepancy is None else asdict(self.discrepancy),
            "effects": [member_document(effect) for effect in model.effects],
            "held": sorted(model.fixed),
            "parameters": [
                {
                    "name": p.name,
                    "unit": p.unit,
                    "nominal": p.nominal,
                    "change": change,
                    "sigma": sigma,
                    "prior_sigma": p.scale,
                }
                for p, change, sigma in zip(model.parameters, self.x.tolist(), self.sigma.tolist(), strict=True)
            ],
            "scanner_T_base": {} if model.robot.carries_scanner else self.scanner_T_base,
            "scanner_T_flange": self.scanner_T_base if model.robot.carries_scanner else {},
            "covariance": [row[: i + 1] for i, row in enumerate(self.covariance)],
        }
        lines = (to_json({key: value})[1:-1] for key, value in document.items())
        return "{\n" + ",\n".join(lines) + "\n}\n"

    def _brief(self) -> str:
        effects = ", ".join(self.model.family_names) or "none"
        errors = errors_in_short(self.before, self.after)
        return f"{self.model.robot.name}, fitted to {self.source.dataset}: {errors}, effects: {effects}"


def _source(dataset: Dataset, outliers: tuple[str, ...]) -> Source:
    fitted = without_poses(dataset, outliers) if outliers else dataset
    points = fitted.points
    assert points is not None
    seen = np.unique(points.pose[~dataset.poses.is_test[points.pose]])
    return Source(dataset.name, tuple(dataset.poses.ids[i] for i in seen), Origin.of(dataset), fitted.left_out)


def _has(poses: Poses, column: str) -> bool:
    if column in CONDITIONS:
        return getattr(poses, column) is not None
    if quantity_of(column) == "approach" and poses.approach is not None:
        return True
    return column in poses.extra.names
