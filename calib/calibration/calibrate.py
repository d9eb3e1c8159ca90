"""Calibration: dataset in, fitted model out, with what it was like before and after on training and test poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calib.blas_threads import one_blas_thread
from calib.calibration.evaluation import Evaluation, Figures, evaluate_all
from calib.calibration.orientation_errors import Attitudes, attitude_lines, evaluate_attitudes
from calib.dataset.dataset import Dataset
from calib.effects.effect import Effect
from calib.effects.link_errors import LinkErrors
from calib.errors import FitError
from calib.fitting.model import Model, geometric_model
from calib.fitting.observations import Observations, place_scanner
from calib.fitting.pose_residuals import require_orientations
from calib.fitting.position_residuals import make_residuals
from calib.fitting.robust import solve_robustly
from calib.fitting.trust_region import Fit, Iteration, solve
from calib.identifiability.structural import fewest_poses, structural_rank
from calib.kinematics.robot import Robot
from calib.options import FitOptions

Array = NDArray[np.float64]

MOST_TOLERANCE = 1e6  # mm or rad: whoever wants no prior switches it off


@dataclass(frozen=True)
class Step:
    """One iteration as the user sees it: 3D error of training and test poses (nan without test poses)."""

    train_rmse_mm: float
    test_rmse_mm: float
    train_distance_rmse_mm: float
    test_distance_rmse_mm: float


@dataclass(frozen=True)
class Calibration:
    """A fitted model and how it stands to the measurements."""

    dataset: Dataset
    model: Model
    options: FitOptions  # what was asked of the fit
    fit: Fit
    before: Evaluation
    after: Evaluation
    weights: Array | None = None  # of the training points, where the fit was robust

    @property
    def residual(self) -> str:
        """What was made small, of `calib.options.RESIDUAL_KINDS`."""
        return self.options.residual

    @property
    def robot(self) -> Robot:
        """The robot with the fitted table."""
        return self.model.calibrated_robot(self.fit.x)

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """One an iteration, the first is the nominal robot; worked out when first asked for."""
        at = evaluate_all(self.model, [step.x for step in self.fit.iterations], self.dataset)
        return tuple(_step(evaluation) for evaluation in at)

    @cached_property
    def attitudes(self) -> tuple[Attitudes, Attitudes] | None:
        """Errors of the orientations before and after, where they were fitted."""
        if self.residual != "pose":
            return None
        before, after = (
            evaluate_attitudes(self.model, x, self.dataset) for x in (0.0 * self.fit.x, self.fit.x)
        )
        return before, after

    @property
    def faces_named(self) -> str:
        """What told the jig's faces apart, where full poses from scans were fitted; else nothing."""
        points = self.dataset.points
        orientations = None if points is None else points.orientations
        return orientations.named if self.residual == "pose" and orientations is not None else ""

    @property
    def sigma_mm(self) -> float:
        """Residual sigma of one coordinate of one point, by degrees of freedom; nan where none are left."""
        return self.fit.noise * declared_sigma_mm(self.dataset)

    @property
    def warnings(self) -> tuple[str, ...]:
        out = [*self.dataset.warnings, *self.after.notes]
        if not self.fit.converged:
            out.append(f"the fit did not converge: {self.fit.reason}")
        if self.weights is not None:
            rows = np.flatnonzero(self.weights < 0.5)
            poses = Observations.of(self.dataset).points.pose[rows]
            names = ", ".join(self.dataset.poses.ids[i] for i in np.unique(poses)[:8]) or "none"
            out.append(
                f"{len(rows)} points count less than half: {names}; outliers are often physics, look at them"
            )
        return tuple(out)

    def require_improvement(self, *, force: bool = False) -> None:
        """Raise FitError where the result should not be put on a robot: not converged, or worse on test poses."""
        if force:
            return
        way_out = "find out why before you use it, or force it"
        if not self.fit.converged:
            raise FitError(
                f"dataset {self.dataset.name}: the fit did not converge ({self.fit.reason}); {way_out}"
            )
        before, after = self.before.test, self.after.test
        if before is not None and after is not None and after.rmse_mm >= before.rmse_mm:
            raise FitError(
                f"dataset {self.dataset.name}: the test poses got worse, RMSE {before.rmse_mm:.4g} -> "
                f"{after.rmse_mm:.4g} mm; {way_out}"
            )

    def to_frame(self) -> pd.DataFrame:
        """The parameters: name, nominal, value, change, sigma, tolerance, unit, and whether the data know them."""
        parameters = self.fit.parameters
        return pd.DataFrame(
            {
                "name": [p.name for p in parameters],
                "nominal": [p.nominal for p in parameters],
                "value": [p.nominal + v for p, v in zip(parameters, self.fit.x, strict=True)],
                "change": self.fit.x,
                "sigma": self.fit.sigma,
                "tolerance": [p.scale for p in parameters],
                "unit": [p.unit for p in parameters],
                "known": self.fit.sigma < 0.5 * self.model.scales,
            }
        )

    def summary(self) -> str:
        lines = [f"{self.dataset.name}: {self.residual} residual, {self.fit.summary()}"]
        for label, before, after in (
            ("train", self.before.train, self.after.train),
            ("test ", self.before.test, self.after.test),
        ):
            if before is not None and after is not None:
                lines.append(f"{label} {figures_line(before, after)}")
        if self.attitudes is not None:
            lines += attitude_lines(*self.attitudes)
        if self.faces_named:
            lines.append(self.faces_named)
        return "\n".join([*lines, *self.warnings])


def figures_line(before: Figures, after: Figures) -> str:
    """Before and after in one line, with the change in per cent."""

    def fall(name: str, a: float, b: float) -> str:
        share = f" ({100.0 * (b / a - 1.0):+.1f} %)" if a > 0.0 else ""
        return f"{name} {a:.4g} -> {b:.4g} mm{share}"

    return ", ".join(
        [
            fall("RMSE", before.rmse_mm, after.rmse_mm),
            fall("max", before.max_mm, after.max_mm),
            fall("distance max", before.distance_max_mm, after.distance_max_mm),
            fall("distance mean", before.distance_mean_mm, after.distance_mean_mm),
        ]
    )


def declared_sigma_mm(dataset: Dataset) -> float:
    """RMS over the measured points of what their covariances declare for one coordinate."""
    covariance = Observations.of(dataset).covariance_mm2
    return float(np.sqrt(np.mean(np.trace(covariance, axis1=-2, axis2=-1)) / 3.0))


@one_blas_thread()
def calibrate(
    dataset: Dataset,
    options: FitOptions = FitOptions(),
    *,
    effects: Sequence[Effect] = (),
    sizes: Mapping[str, float] | None = None,
    start: Calibration | None = None,
) -> Calibration:
    """Fit the link errors, and further effects, to the training poses of a dataset.

    Effects are added to a fit, an earlier one or that of the link errors alone, and gravity's loads are worked out at
    its links: by how much effects then still move them, some 1e-3 rad, a load changes by 1e-3 of itself.

    Args:
        dataset: with measured points.
        options: what is asked of the fit; the result keeps it.
        effects: beyond the link errors.
        sizes: of the effects' parameters, by full name, where their usual scale is not the prior to use.
        start: an earlier fit of the same arm to go on from, by its parameters' names. It saves iterations.

    Raises:
        FitError: no points, an unknown name, or fewer equations than the data would have to settle.
    """
    residual, prior = options.residual, options.prior
    links = LinkErrors(dataset.robot, checked_tolerances(dataset.robot, options.tolerances))
    model = Model(dataset.robot, (links, *effects), sizes=sizes or {}).hold(options.held)
    observed = Observations.of(dataset)
    if len(observed.points) < 3:
        raise FitError(
            f"dataset {dataset.name}: {len(observed.points)} training points; a fit needs many more"
        )
    nominal = geometric_model(dataset.robot)
    observed = place_scanner(observed, nominal, np.zeros(len(nominal.parameters)))
    if residual == "pose":
        require_orientations(dataset, observed)
    residuals = make_residuals(residual, model, observed)
    rows = len(residuals.residual(np.zeros(len(model.parameters))))
    _require_equations(dataset, observed, residual, rows - residuals.degrees_spent, rank=0)
    if options.robust and residual == "distance":
        raise FitError("robust weights need a residual of each point; take position, pairs or pose")
    way: tuple[Iteration, ...] = ()  # that led to where this fit begins
    links_alone = Model(dataset.robot, (links,), model.fixed)
    if start is not None:
        way = _in_order_of(model, start.fit)
    elif effects and links_alone.parameters:
        way = _in_order_of(model, solve(make_residuals(residual, links_alone, observed), prior=prior))
    first_x = way[-1].x if way else np.zeros(len(model.parameters))
    if effects:
        model = model.with_loads_at(first_x)
    weights = None
    if options.robust:
        fit, weights = solve_robustly(
            lambda seen: make_residuals(residual, model, seen), observed, start=first_x, prior=prior
        )
    else:
        fit = solve(make_residuals(residual, model, observed), start=first_x, prior=prior)
    fit = replace(fit, iterations=(*way[:-1], *fit.iterations))
    _require_equations(dataset, observed, residual, fit.rows - residuals.degrees_spent, fit.rank)
    if fit.rank == 0:
        raise FitError(
            f"dataset {dataset.name}: the training poses tell nothing of the arm's parameters; they are all alike, or "
            "the points do not depend on the joints: measure poses that differ"
        )
    before, after = evaluate_all(model, [np.zeros(len(fit.x)), fit.x], dataset)
    return Calibration(
        dataset=dataset,
        model=model,
        options=options,
        fit=fit,
        before=before,
        after=after,
        weights=weights,
    )


def _in_order_of(model: Model, fit: Fit) -> tuple[Iteration, ...]:
    """A fit's iterations with their parameters in the order of another model's; zero where the fit did not have one."""

    def in_order(x: Array) -> Array:
        values = dict(zip((p.name for p in fit.parameters), x.tolist(), strict=True))
        return np.array([values.get(p.name, 0.0) for p in model.parameters])

    return tuple(replace(step, x=in_order(step.x)) for step in fit.iterations)


def _require_equations(
    dataset: Dataset, observed: Observations, kind: str, equations: int, rank: int
) -> None:
    """Raise FitError where poses give no more equations than directions to settle, with the number that would do."""
    if equations > rank:
        return
    arm = structural_rank(dataset.robot, residual=kind)
    knowable, what = (rank, "arm and effects have") if rank > arm else (arm, "the arm has")
    needed = fewest_poses(dataset.robot, residual=kind, setups=len(np.unique(observed.setup)), rank=rank)
    raise FitError(
        f"dataset {dataset.name}: {len(np.unique(observed.points.pose))} training poses give {max(equations, 0)} "
        f"equations, {what} {knowable} knowable parameters; measure at least {needed} different poses, better "
        "three times as many"
    )


def checked_tolerances(robot: Robot, tolerances: Mapping[str, float]) -> Mapping[str, float]:
    """The tolerances, all of known parameters and above 0; FitError otherwise."""
    for name, value in tolerances.items():
        if name not in robot.parameter_names:
            raise FitError(
                f"no parameter named {name!r}; there are {', '.join(robot.parameter_names[:6])} ..."
            )
        if not 0.0 < value <= MOST_TOLERANCE:
            raise FitError(
                f"tolerance of {name}: found {value!r}; a size above 0 and up to {MOST_TOLERANCE:g} is needed, "
                "in mm or rad"
            )
    return tolerances


def _step(evaluation: Evaluation) -> Step:
    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")

    train, test = evaluation.train, evaluation.test
    of_test = evaluation.is_test[evaluation.distance_pose]
    return Step(
        train.rmse_mm if train else float("nan"),
        test.rmse_mm if test else float("nan"),
        rms(evaluation.distance_error_mm[~of_test]),
        rms(evaluation.distance_error_mm[of_test]),
    )
