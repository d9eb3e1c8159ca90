"""Calibration of an arm from a dataset: the fit with its errors on training and test poses, before and after."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from calib.array_types import Array, BoolArray
from calib.blas_threads import one_blas_thread
from calib.calibration.arm_error_covariance import ROUNDS, arm_noise, counts_arm_as_noise, with_arm_noise
from calib.calibration.evaluation import evaluate_all
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.lengths import with_directions
from calib.dataset.repeats import average_repeats
from calib.effects.effect import Effect, is_held_by_prior
from calib.effects.gravity import has_masses, tells_tool_mass
from calib.effects.link_errors import LinkErrors, TargetOffsets
from calib.effects.place_errors import place_errors_of
from calib.errors import FitError
from calib.fitting.distance_residuals import DistanceResiduals
from calib.fitting.fit import Fit
from calib.fitting.fit_task import FitTask, Fitted
from calib.fitting.model import Model
from calib.fitting.observations import (
    Observations,
    observed_hand_eye,
    predict_points,
    with_nominal_scanner_frames,
    with_observed_targets,
)
from calib.fitting.pose_residuals import PoseResiduals, require_orientations
from calib.fitting.position_residuals import PositionResiduals
from calib.fitting.residual_kinds import make_residuals
from calib.fitting.robust import BACK_LEVEL, LEVEL, fit_inliers, inlying_points, resistant_core
from calib.fitting.table_evidence import TIP, sigmas_near_table
from calib.fitting.tool_point import fixed_behind_tool_point
from calib.frames import frames_by_name
from calib.identifiability.structural import fewest_poses, structural_rank
from calib.kinematics.cartesian import with_board_anywhere
from calib.kinematics.robot import TOOL_POINT, Robot
from calib.kinematics.statics import uncertain_loads
from calib.kinematics.tool_point import tool_point_of
from calib.options import LINKS, FitOptions

UNTOLD_TOOL_KG = 2.0
"""Sigma of the mass of a tool that was found where robot.toml has none: a probe or a gripper."""
HEAVY_FROM_MM = 50.0
"""How far off a tool point is at least that a tool of some weight holds there, rather than the foot of a mirror."""
_LENGTH_ROUNDS = 6  # in which the lines of measured lengths are made anew
_SAME_LINE_MM = 0.05  # by which the end of a line may still move: of a metre it changes the length by a nanometre


@one_blas_thread()
def fit_measured(
    dataset: Dataset,
    options: FitOptions | None = None,
    *,
    effects: Sequence[Effect] = (),
    prior_sigmas: Mapping[str, float] | None = None,
    start: Calibration | None = None,
) -> Calibration:
    """Calibration of a dataset with measured points: the link errors and given effects, fitted to its training poses.

    The function for users, `calib.calibrate`, says what is fitted how; `options` are by default the usual ones of the
    dataset. Raises FitError.
    """
    options = with_links_held(options or FitOptions(residual=dataset.usual_residual), dataset.robot)
    members, prior_sigmas = tuple(effects), prior_sigmas or {}
    if dataset.points is None or dataset.points.lengths is None:
        calibration = _calibrated(dataset, options, members, prior_sigmas, start)
        if not counts_arm_as_noise(calibration, options):
            return calibration
        noise = arm_noise(calibration, dataset)
        for _ in range(ROUNDS):
            calibration = _calibrated(with_arm_noise(dataset, noise), options, members, prior_sigmas, start)
            before, noise = noise, arm_noise(calibration, dataset)
            if noise.is_near(before):
                break
        return calibration
    if options.residual != "position" or options.robust:
        raise FitError(f"dataset {dataset.name}: measured lengths take residual position, and no robust fit")
    for _ in range(_LENGTH_ROUNDS):
        calibration = _calibrated(dataset, options, members, prior_sigmas, start)
        seen_mm = _seen_from_anchors(calibration)
        turned = float(np.abs(seen_mm - dataset.points.xyz_mm).max())
        dataset, start = dataset.with_points(with_directions(dataset.points, seen_mm)), calibration
        if turned < _SAME_LINE_MM:
            break
    return calibration


def _seen_from_anchors(calibration: Calibration) -> Array:
    """Predicted places (M, 3), mm from their anchors, of all targets whose lengths a calibration's dataset has."""
    dataset, frames_of = calibration.dataset, calibration.after.scanner_T_base
    observed = Observations.of_all(dataset)
    base_mm = predict_points(calibration.model, calibration.fit.x, observed)
    placed = frames_by_name(frames_of, observed.setup)
    return np.einsum("mij,mj->mi", placed[:, :3, :3], base_mm) + placed[:, :3, 3]


def _calibrated(
    dataset: Dataset,
    options: FitOptions,
    members: tuple[Effect, ...],
    prior_sigmas: Mapping[str, float],
    start: Calibration | None,
) -> Calibration:
    """Calibration of a measured dataset with the link errors and given effects."""
    residual = options.residual
    if options.noise is not None:
        dataset = replace(dataset, noise=options.noise)
    given, dataset = dataset, with_repeats_averaged(dataset, residual)
    observed = Observations.of(dataset)
    robot = with_observed_targets(with_board_anywhere(dataset.robot), observed)
    if robot.carries_scanner:
        _require_placed(dataset, observed)
    places = place_errors_of(dataset) if options.prior else None  # without a prior they would take any scale
    geometry = (*geometry_of(robot, observed, options), *([] if places is None else [places]))
    fixed = (*options.fixed, *fixed_behind_tool_point(robot, observed))
    model = _with_prior(Model(robot, (*geometry, *members), prior_sigmas=prior_sigmas), options).with_fixed(fixed)
    if len(observed.points) < 3:
        raise FitError(f"dataset {dataset.name}: {len(observed.points)} training points; a fit needs many more")
    if residual == "pose":
        require_orientations(dataset, observed)
    residuals = make_residuals(residual, model, with_nominal_scanner_frames(observed, robot))
    rows = len(residuals.residual(np.zeros(len(model.parameters))))
    _require_equations(dataset, observed, residual, rows - residuals.degrees_spent, rank=0)
    if options.robust and residual == "distance":
        raise FitError("a robust fit needs a residual of each point; take position, pairs or pose")
    task = FitTask(model, geometry, observed, options)
    fitted, kept = _fitted(task, start)
    fitted = _near_table(task.of(kept), fitted)
    model = fitted.model
    fit = _with_load_uncertainty(residual, model, fitted.fit, observed.select(kept))
    spared = sum(len(effect.parameters) for effect in model.effects if is_held_by_prior(effect))
    _require_equations(dataset, observed, residual, fit.rows - residuals.degrees_spent, fit.rank - spared)
    if fit.rank == 0:
        raise FitError(
            f"dataset {dataset.name}: the training poses tell nothing of the arm's parameters; they are all alike, or "
            "the points do not depend on the joints: measure poses that differ"
        )
    outliers = tuple(dataset.poses.ids[i] for i in np.unique(observed.points.pose[~kept]))
    found = _shared_errors(model, options, observed.select(kept), fit.x)
    averaged = None if dataset is given else dataset.free_of_shared(found)
    given = given.free_of_shared(found)
    as_delivered, at_fit = evaluate_all(model, [model.delivered(fit.x), fit.x], given, outliers)
    return Calibration(
        dataset=given,
        model=model,
        options=options,
        fit=fit,
        before=as_delivered,
        after=at_fit,
        outliers=outliers,
        averaged=averaged,
    )


def _shared_errors(model: Model, options: FitOptions, observed: Observations, x: Array) -> Array | None:
    """What a fit of full poses finds of the errors (K,) that all points share, in their sigmas; None without any."""
    if options.residual != "pose" or observed.points.shared is None:
        return None
    return PoseResiduals(model, with_nominal_scanner_frames(observed, model.placed_robot)).shared_errors(x)


def with_links_held(options: FitOptions, robot: Robot) -> FitOptions:
    """The options with the word "links" among the fixed parameters replaced by the names of the arm's own parameters.

    The tool's row is not among them: no table knows where target or instrument are mounted. An arm that stands for
    poses of the flange has no links to fit.
    """
    if LINKS not in options.fixed and not robot.is_cartesian:
        return options
    of_arm = [name for name in robot.parameter_names if not name.endswith(TIP)]
    return replace(options, fixed=tuple(dict.fromkeys([name for name in options.fixed if name != LINKS] + of_arm)))


def _with_prior(model: Model, options: FitOptions) -> Model:
    """Model with the prior that other arms of the type tell, except where the user gives a tolerance."""
    prior = options.type_prior
    if prior is None:
        return model
    asked = options.tolerances
    sigmas = {name: sigma for name, sigma in prior.sigmas.items() if name not in asked}
    means = {name: mean for name, mean in prior.means.items() if name not in asked}
    return replace(model, prior_sigmas={**model.prior_sigmas, **sigmas}, prior_means=means)


def _fitted(task: FitTask, start: Calibration | None) -> tuple[Fitted, BoolArray]:
    """Fitted model, and a mask (M,) of the points used: all, or in a robust fit those of inlying poses."""
    observed, options = task.observed, task.options
    before = None if start is None else Fitted(start.model, start.fit)
    kept = np.ones(len(observed.points), dtype=bool)
    if not options.robust:
        return _fitted_from(task, before), kept
    if start is not None and start.options.robust:
        gone = [i for i, pose_id in enumerate(observed.poses.ids) if pose_id in start.outliers]
        kept = ~np.isin(observed.points.pose, gone)
    else:
        kept = resistant_core(_maker(task.of_geometry_alone().model, options), observed, prior=options.prior)

    def inliers(fitted: Fitted, kept: BoolArray, back_level: float) -> BoolArray:
        make = _maker(fitted.model, options)
        return inlying_points(make, observed, fitted.fit, kept, prior=options.prior, back_level=back_level)

    refit = start is not None and start.options.robust
    first_back_level = BACK_LEVEL if refit else LEVEL
    return fit_inliers(lambda kept: _fitted_from(task.of(kept), before), inliers, kept, first_back_level)


def _fitted_from(task: FitTask, before: Fitted | None) -> Fitted:
    """Fitted model, started from an earlier fit or else from a fit of the corrections of robot.toml alone."""
    alone = task.of_geometry_alone()
    if before is None and task.model.added_effects and alone.model.parameters:
        before = alone.fitted_to_tool()
    return task.fitted_to_tool() if before is None else task.fitted(before.model.tool_found, before.fit)


def _near_table(task: FitTask, fitted: Fitted) -> Fitted:
    """Fitted model whose links are held as in robot.toml where the points say that they are so; else as given."""
    noise = task.options.noise
    if not task.options.prior or (noise is not None and noise.tail is not None):
        return fitted
    model = fitted.model
    placed = with_nominal_scanner_frames(task.observed, model.placed_robot)
    residuals = make_residuals(task.options.residual, model, placed)
    sigmas = sigmas_near_table(model, task.links, residuals, fitted.fit)
    if not sigmas:
        return fitted
    held = replace(task.model, prior_sigmas={**task.model.prior_sigmas, **sigmas})
    return replace(task, model=held).fitted(model.tool_found)


def _maker(model: Model, options: FitOptions) -> Callable[[Observations], PositionResiduals | PoseResiduals]:
    """Function that makes the least-squares residuals of a model from observations."""

    def make(observed: Observations) -> PositionResiduals | PoseResiduals:
        placed = with_nominal_scanner_frames(observed, model.placed_robot)
        residuals = make_residuals(options.residual, model, placed)
        assert not isinstance(residuals, DistanceResiduals)
        return residuals

    return make


def with_repeats_averaged(dataset: Dataset, residual: str) -> Dataset:
    """Dataset with the repeats of each pose replaced by their mean, as repeats are no independent poses.

    Unchanged where no group has several repeats, and where there are fewer groups than a fit needs: then the prior
    decides, and the repeats tell only how they scatter.
    """
    averaged = average_repeats(dataset)
    if averaged is dataset or averaged.points is None:
        return dataset
    poses = averaged.poses
    used = np.unique(averaged.points.pose[~poses.is_test[averaged.points.pose]])
    needed = fewest_poses(dataset.robot, residual=residual, setups=len(np.unique(poses.setup[used])))
    return averaged if len(used) >= needed else dataset


def _require_equations(dataset: Dataset, observed: Observations, kind: str, equations: int, rank: int) -> None:
    """Raise FitError, with the number of poses needed, where equations are no more than the unknowns."""
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


def _require_placed(dataset: Dataset, observed: Observations) -> None:
    """Raise FitError where training points do not locate a flange-mounted scanner or miss a test pose's target."""
    assert dataset.points is not None
    unknown = sorted(set(dataset.points.target.tolist()) - set(observed.targets))
    if unknown:
        raise FitError(
            f"dataset {dataset.name}: target {unknown[0]!r} is measured at no training pose, so its place in the room "
            "is not known; give it training poses, or leave it out"
        )
    if observed_hand_eye(dataset.robot, observed).undetermined_rotation:
        raise FitError(
            f"dataset {dataset.name}: the training points do not tell how the scanner is turned on the flange: they "
            "lie in one place or on one line, seen from the scanner; measure poses that differ in more directions"
        )


def geometry_of(robot: Robot, observed: Observations, options: FitOptions) -> tuple[Effect, ...]:
    """Corrections of robot.toml that every fit includes: link errors, and positions of further measured targets.

    Residuals of distances are of the tool point alone and leave further targets out. Raises FitError on a tolerance of
    an unknown parameter.
    """
    measured = {TOOL_POINT} if options.residual == "distance" else observed.targets
    targets = tuple(target for target in robot.targets if target.name in measured)
    offsets = TargetOffsets(targets, options.tolerances)
    names = (*robot.parameter_names, *(p.name for p in offsets.parameters))
    links = LinkErrors(robot, checked_tolerances(names, options.tolerances))
    return (links, offsets) if targets else (links,)


def checked_tolerances(names: Sequence[str], tolerances: Mapping[str, float]) -> Mapping[str, float]:
    """Tolerances by parameter name, after a check of the names. Raises FitError for an unknown parameter."""
    for name in tolerances:
        if name not in names:
            raise FitError(f"no parameter named {name!r}; there are {', '.join(names[:6])} ...")
    return tolerances


def _with_load_uncertainty(kind: str, model: Model, fit: Fit, observed: Observations) -> Fit:
    """Fit whose sigmas have what uncertain loads make of the parameters; itself where none is known to be uncertain.

    These are the noise of measured torques, and a tool that was found far from robot.toml's and whose mass no file
    tells. An effect under load is fitted as if the load were known. Where the load is off, the parameters move: to
    first order by -C J^T c, with the fit's covariance C over the noise's variance, its Jacobian J, and the change c of
    the residual. What the tool's mass moves is no part of the covariance: with the mass the prediction moves back.
    `kind` is the residual's.
    """
    robot = model.loads_of
    if robot is None or not np.isfinite(fit.reduced_chi) or not fit.reduced_chi > 0.0:
        return fit
    measured, untold = [*uncertain_loads(robot)], _with_untold_tool(robot, model, observed)
    if not measured and untold is None:
        return fit
    placed = with_nominal_scanner_frames(observed, model.placed_robot)
    at = make_residuals(kind, model, placed).linearise(fit.x)
    gain = fit.covariance / fit.reduced_chi**2 @ at.jacobian.T

    def moved_by(variant: Robot) -> Array:
        changed = make_residuals(kind, replace(model, loads_of=variant), placed).residual(fit.x)
        return np.asarray(gain @ (changed - at.residual))

    covariance = fit.covariance.copy()
    for variant in measured:
        moved = moved_by(variant)
        covariance += np.outer(moved, moved)
    return replace(fit, covariance=covariance, load_moves=0.0 if untold is None else moved_by(untold))


def _with_untold_tool(robot: Robot, model: Model, observed: Observations) -> Robot | None:
    """The robot with a tool as heavy as it may be where no file tells its mass; None where that is of no use."""
    told = tells_tool_mass(robot, observed.poses.payload_kg) or not has_masses(robot)
    if model.tool_found is None or told or not model.added_effects:
        return None
    if np.linalg.norm(tool_point_of(model.tool_found) - tool_point_of(model.robot)) < HEAVY_FROM_MM:
        return None
    x_mm, y_mm, z_mm = (0.5 * tool_point_of(model.tool_found)).tolist()
    return replace(robot, tool=replace(robot.tool, mass_kg=UNTOLD_TOOL_KG, com_mm=(x_mm, y_mm, z_mm)))


def fit_again(calibration: Calibration, dataset: Dataset, options: FitOptions) -> Calibration:
    """A calibration's model fitted again to other measurements of the arm, or with other options. Raises FitError."""
    model = calibration.model
    return fit_measured(
        dataset, options, effects=model.added_effects, prior_sigmas=model.prior_sigmas, start=calibration
    )
