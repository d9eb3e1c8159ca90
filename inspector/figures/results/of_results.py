"""Figures of results: each function takes a result of `calib` and returns a plotly figure with a title."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from calib.calibration.model_versions import NOMINAL, model_name
from calib.calibration.noise_level import noise_level
from calib.calibration.pose_errors import PoseErrors, pose_errors_of, running_median
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.result import Diagnosis
from calib.errors import CalibError
from calib.identifiability.redundancy import Redundancy
from calib.identifiability.structural import redundancy_of
from calib.intervention.proof import Intervention
from calib.kinematics.robot import Robot
from calib.planning.plan import Plan
from calib.present.fit.residuals import AXES, LENGTH, joint_title, shown, turned
from calib.present.names import input_title
from calib.screening.curves.fitted_curves import fitted_curves
from calib.validation.cross_validation import LearningCurve
from inspector.figures import curve_plots, plots, residual_plots
from inspector.figures.results.alone import titled

_TALL_PX = 620  # of a figure of one scale both ways


def error_bars(calibration: Calibration) -> go.Figure:
    """Bars of the 3D error of each pose after a fit, mm, training and test poses in their colours."""
    frame = calibration.after.to_frame(calibration.dataset)
    drawn = plots.pose_residuals(
        frame["pose"].tolist(), frame["role"].tolist(), frame["error_mm"].to_numpy(), what="3D error"
    )
    return titled(drawn, f"Error at each pose after the fit: {calibration.dataset.name}")


def residuals_over(of: Calibration | Diagnosis, over: str = "q1", show: str | int = "length") -> go.Figure:
    """Figure of each pose's residual against an input, with the noise band.

    Args:
        of: a fit, or a diagnosis, whose last fit is shown.
        over: the input on the x axis: q1 ... (degrees; mm of a slide), torque1 ... (Nm, by gravity), payload_kg,
            temperature_c, time_s, order, x, y, z (place in the scanner's frame), or a further column of poses.csv.
        show: "length" of the error; "x", "y" or "z", its part along an axis of the scanner; or a joint, counted from 1:
            the motion of that joint alone that would explain the error best.

    Raises CalibError on a name or a joint that there is not; it lists those that there are.
    """
    calibration = of.calibration
    errors, robot = pose_errors_of(calibration), calibration.dataset.robot
    if over not in errors.inputs:
        raise CalibError(f"no input named {over!r}; there are {', '.join(errors.inputs)}")
    x = turned(over, errors.inputs[over], robot)
    y, y_title, band = _shown(errors, show, robot)
    train, x_title = ~errors.is_test, input_title(over, robot)
    drawn = residual_plots.residual_against(
        x, y, errors.pose_ids, errors.is_test, x_title=x_title, y_title=y_title, band=band,
        smooth=running_median(x[train], y[train]),
    )  # fmt: skip
    return titled(drawn, f"What is left over: {calibration.dataset.name}")


def _shown(errors: PoseErrors, show: str | int, robot: Robot) -> tuple[np.ndarray, str, tuple[float, float]]:
    """Values of an input, its name with unit, and the band of the noise."""
    if isinstance(show, int):
        if not 1 <= show <= robot.n_joints:
            raise CalibError(f"no joint {show}; {robot.name} has joints 1 to {robot.n_joints}")
        return shown(errors, joint_title(show - 1, robot), show - 1, robot)
    names = {"length": LENGTH, **dict(zip("xyz", AXES, strict=True))}
    if show not in names:
        raise CalibError(f"cannot show {show!r}; there are length, x, y, z, or a joint's number")
    return shown(errors, names[show], None, robot)


def convergence(calibration: Calibration) -> go.Figure:
    """Figure of the RMS error at each iteration of the fit, mm, logarithmic; iteration 0 is the nominal robot."""
    steps = calibration.iteration_errors
    drawn = plots.convergence([s.train_rmse_mm for s in steps], [s.test_rmse_mm for s in steps])
    return titled(drawn, f"Convergence of the fit: {calibration.dataset.name}")


def redundancy_heatmap(of: Redundancy | Dataset | Calibration) -> go.Figure:
    """Heatmap of Pearson's r between the Jacobian's columns of each pair of parameters (Park 2022).

    Dark red or dark blue off the diagonal (r = 1, r = -1): only one of the two can be known. Grey: no influence.

    Args:
        of: a dataset or a calibration, whose training poses count, or an analysis of
            `calib.redundancy`.
    """
    if isinstance(of, Calibration):
        analysis, name = redundancy_of(of.dataset, residual=of.residual), f": {of.dataset.name}"
    elif isinstance(of, Dataset):
        analysis, name = redundancy_of(of), f": {of.name}"
    else:
        analysis, name = of, ""
    drawn = plots.correlation_heatmap(analysis.parameters, analysis.pearson)
    return titled(drawn, f"Which parameters act alike{name}", height_px=_TALL_PX)


# ---- a diagnosis: how the error fell, which effects could be missing, what was learned -------------------------------


def history_of_model(steps: Sequence[FitStep]) -> go.Figure:
    """Figure of the 3D error after each step of a model, with that of each test pose, without title or ground."""
    last = steps[-1].calibration
    stages = [last.before, *(step.calibration.after for step in steps)]
    labels = [NOMINAL, *(step.label for step in steps)]
    train = [np.nan if s.train is None else s.train.rmse_mm for s in stages]
    test = [np.nan if s.test is None else s.test.rmse_mm for s in stages]
    level, poses = noise_level(last), last.dataset.poses
    single = [
        {
            poses.ids[pose]: float(mm)
            for pose, mm in zip(stage.pose, np.linalg.norm(stage.error_mm, axis=1), strict=True)
            if poses.is_test[pose]
        }
        for stage in stages
    ]
    return plots.error_history(labels, train, test, level.floor_mm, noise=level.name, test_poses_mm=single)


def error_history(of: Diagnosis | Sequence[FitStep]) -> go.Figure:
    """Figure of the 3D error (RMS, mm, logarithmic) of training and test poses after each added effect.

    Dashed: what noise alone leaves, as the dataset declares it, as repeats show it, or as the fit left it.

    Args:
        of: a diagnosis, or the steps of a model, as `calib.diagnosis.search_space.add_in_turn` makes them.
    """
    steps = of.steps if isinstance(of, Diagnosis) else of
    last = steps[-1].calibration
    drawn = history_of_model(steps)
    return titled(drawn, f"The error falls: {last.dataset.name}")


def moved_by_change(intervention: Intervention) -> go.Figure:
    """Figure of what a changed condition moved each target by, mm, against what the proven causes explain of it.

    Raises CalibError where no pairs were measured.
    """
    moved = intervention.displacements
    if moved is None:
        raise CalibError("no pairs were measured; give one of `Diagnosis.interventions`")
    drawn = residual_plots.moved_by_change(moved.moved_mm, moved.explained_mm, moved.names, moved.held_out)
    return titled(drawn, f"Moved by a change of {', '.join(intervention.conditions)}")


def learned_curves(of: Calibration | Diagnosis) -> go.Figure:
    """Figure of the learned curves of the joints (`smooth_joint_error`): error over input with a band of two sigmas.

    mrad over degrees, or the units of the input; grey where nothing was measured. Raises CalibError where the model has
    none.
    """
    calibration = of.calibration
    curves = fitted_curves(calibration)
    if not curves:
        inside = model_name(calibration.model)
        raise CalibError(f"dataset {calibration.dataset.name}: no curves were learned; the model is {inside}")
    drawn = curve_plots.joint_curves(curves, calibration.dataset.robot, columns=min(len(curves), 2))
    height = curve_plots.height_px(len(curves), min(len(curves), 2))
    return titled(drawn, f"Learned curves: {calibration.dataset.name}", height_px=height)


# ---- after a fit: more poses -----------------------------------------------------------------------------------------


def learning_curve(curve: LearningCurve) -> go.Figure:
    """Figure of the RMS error of fitted and held-out poses, mm, against the number of fitted poses.

    Bars: the spread over draws of the poses. Where the two lines meet, more poses help no more.
    """
    return titled(plots.errors_by_poses(curve), f"Would more poses help: {curve.dataset.name}")


def plan_curve(plan: Plan) -> go.Figure:
    """Figure of the predicted error, mm, by number of further poses, with the number from which gains are small."""
    return titled(plots.error_by_count(plan), f"What further poses promise: {plan.start.dataset.name}")
