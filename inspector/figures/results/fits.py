"""Figures of a fit: its errors, pose by pose, over an input and over the work space; which parameters can be known.

Each shows what the page and the report show of it, with a title, axes with units, and hover texts, on a background of
its own, light or (`dark=True`) dark, so that it is legible in any notebook. Nothing is computed here but by `calib`.
"""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from calib.calibration.pose_errors import PoseErrors, pose_errors_of, running_median
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.diagnosis.result import Diagnosis
from calib.errors import CalibError
from calib.identifiability.redundancy import Redundancy
from calib.identifiability.structural import redundancy
from calib.kinematics.chain import target_points
from calib.kinematics.robot import Robot
from calib.present.residuals import AXES, LENGTH, input_title, joint_title, shown, turned
from inspector.figures import (
    plots,
    residual_plots,
)
from inspector.figures.results.alone import titled

_TALL_PX = 620  # of figures of one scale both ways


def error_bars(calibration: Calibration, *, before: bool = False, dark: bool = False) -> go.Figure:
    """The 3D error of each pose, mm: a bar a pose, training and test poses in their colours.

    Args:
        calibration: a fit, of `calib.calibrate` or the `.calibration` of a diagnosis.
        before: of the nominal robot instead of the fitted one.
    """
    frame = (calibration.before if before else calibration.after).to_frame(calibration.dataset)
    drawn = plots.pose_residuals(
        frame["pose"].tolist(),
        frame["role"].tolist(),
        frame["error_mm"].to_numpy(),
        what="3D error",
        dark=dark,
    )
    model = "as delivered" if before else "after the fit"
    return titled(drawn, f"Error at each pose {model}: {calibration.dataset.name}", dark=dark)


def residuals_over(
    of: Calibration | Diagnosis, over: str = "q1", *, show: str | int = "length", dark: bool = False
) -> go.Figure:
    """What the fit leaves over at each pose against something that it may depend on, with the band of noise alone.

    Args:
        of: a fit, or a diagnosis, whose last fit is shown.
        over: the input on the x axis: q1 ... (degrees; mm of a slide), torque1 ... (Nm, by gravity), payload_kg,
            temperature_c, time_s, order, x, y, z (place in the scanner's frame), or a further column of poses.csv.
        show: "length" of the error; "x", "y" or "z", its part along an axis of the scanner; or a joint, counted from 1:
            the motion of that joint alone that would explain the error best.

    Raises CalibError on a name or a joint that there is not; it lists those that there are.
    """
    calibration = of.calibration if isinstance(of, Diagnosis) else of
    errors, robot = pose_errors_of(calibration), calibration.dataset.robot
    if over not in errors.inputs:
        raise CalibError(f"no input named {over!r}; there are {', '.join(errors.inputs)}")
    x = turned(over, errors.inputs[over], robot)
    y, y_title, band = _shown(errors, show, robot)
    train, x_title = ~errors.is_test, input_title(over, robot)
    drawn = residual_plots.residual_against(
        x, y, errors.pose_ids, errors.is_test, x_title=x_title, y_title=y_title, band=band,
        smooth=running_median(x[train], y[train]), dark=dark,
    )  # fmt: skip
    return titled(drawn, f"What is left over: {calibration.dataset.name}", dark=dark)


def work_space(of: Calibration | Diagnosis, *, show: str | int = "length", dark: bool = False) -> go.Figure:
    """Where the error is: each pose's point from above and from the side, mm in the base frame, coloured by the error.

    `of` and `show` as of `residuals_over`.
    """
    calibration = of.calibration if isinstance(of, Diagnosis) else of
    errors = pose_errors_of(calibration)
    values, title, _ = _shown(errors, show, calibration.dataset.robot)
    drawn = residual_plots.place_views(
        errors.place_mm,
        values,
        errors.pose_ids,
        errors.is_test,
        title=title,
        signed=show != "length",
        dark=dark,
    )
    return titled(drawn, f"Error over the work space: {calibration.dataset.name}", dark=dark, height_px=_TALL_PX)


def _shown(errors: PoseErrors, show: str | int, robot: Robot) -> tuple[np.ndarray, str, tuple[float, float]]:
    """The values, their name with the unit, and the band of noise alone."""
    if isinstance(show, int):
        if not 1 <= show <= robot.n_joints:
            raise CalibError(f"no joint {show}; {robot.name} has joints 1 to {robot.n_joints}")
        return shown(errors, joint_title(show - 1, robot), show - 1, robot)
    names = {"length": LENGTH, **dict(zip("xyz", AXES, strict=True))}
    if show not in names:
        raise CalibError(f"cannot show {show!r}; there are length, x, y, z, or a joint's number")
    return shown(errors, names[show], None, robot)


def where_measured(dataset: Dataset, *, dark: bool = False) -> go.Figure:
    """Where the nominal arm has its tool point at each pose, from above and from the side, mm in the base frame.

    Needs no measured points, so it may be drawn of a dataset of scans or of poses that are planned.
    """
    poses, robot = dataset.poses, dataset.robot
    place_mm = target_points(robot, poses.q)
    drawn = residual_plots.places_by_role(place_mm, poses.ids, poses.role.tolist(), dark=dark)
    return titled(drawn, f"Where it is measured: {dataset.name}", dark=dark, height_px=_TALL_PX)


def convergence(calibration: Calibration, *, what: str = "3D", dark: bool = False) -> go.Figure:
    """RMS error at each iteration of the fit, logarithmic, mm; iteration 0 is the nominal robot.

    Args:
        what: "3D" error, or "distance", the error of distances to the reference pose.
    """
    steps = calibration.iteration_errors
    if what not in ("3D", "distance"):
        raise CalibError(f"cannot show {what!r}; there are 3D and distance")
    if what == "3D":
        train, test = [s.train_rmse_mm for s in steps], [s.test_rmse_mm for s in steps]
    else:
        train, test = [s.train_distance_rmse_mm for s in steps], [s.test_distance_rmse_mm for s in steps]
    drawn = plots.convergence(train, test, what=what, dark=dark)
    return titled(drawn, f"Convergence of the fit: {calibration.dataset.name}", dark=dark)


def redundancy_heatmap(of: Redundancy | Dataset | Calibration, *, dark: bool = False) -> go.Figure:
    """Which parameters act alike: Pearson's r between the columns of the Jacobian (Park 2022), for each pair.

    Dark red or dark blue off the diagonal (r = 1, r = -1): only one of the two can be known. Grey: no influence.

    Args:
        of: a dataset or a calibration, whose training poses count, or an analysis of
            `calib.identifiability.structural.redundancy`.
    """
    if isinstance(of, Calibration):
        analysis, name = redundancy(of.dataset, residual=of.residual), f": {of.dataset.name}"
    elif isinstance(of, Dataset):
        analysis, name = redundancy(of), f": {of.name}"
    else:
        analysis, name = of, ""
    drawn = plots.correlation_heatmap(
        analysis.parameters, analysis.pearson, no_influence=analysis.no_influence, dark=dark
    )
    return titled(drawn, f"Which parameters act alike{name}", dark=dark, height_px=_TALL_PX)
