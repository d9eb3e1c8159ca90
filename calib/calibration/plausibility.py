"""Plausibility of a fit: residual, corrections and effects within physical bounds, and no outlying poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.calibration.calibrate import fit_again
from calib.calibration.result import Calibration
from calib.effects.effect import exceeded_bound, full_name
from calib.errors import FitError
from calib.fitting.observations import BEST_SIGMA_MM, Observations
from calib.kinematics.robot import LENGTH_KINDS, PARAMETER_KINDS
from calib.statistics import chi2_ppf

_BY_CHANCE = 1e-6
MAX_TOLERANCES = 30.0
"""Largest plausible correction, in tolerances: 30 mm and 15 deg by default."""
MAX_SHARE_OF_SPAN = 0.02
"""Largest plausible residual sigma, as a share of the RMS spread of the points, whatever effect is missing."""
LEAST_SPAN_OF_REACH = 0.1
"""The spread that points are taken to have, as a share of the arm's length, where a socket or plane holds them."""
FAR_BELOW = 0.2
"""Times the least noise that there can be, below which a residual is too good to be true."""


def implausibility_reason(calibration: Calibration) -> str:
    """Reason why a fit cannot describe this arm (wrong units, signs, order of poses); "" if it is plausible.

    The residual is too large, a correction is far beyond its tolerance, or an effect exceeds its natural bound. Links
    without length, for example, fit a ball in sockets exactly.
    """
    fit, model = calibration.fit, calibration.model
    remedy = (
        "check units, joint signs, the order of the poses, robot.toml, and whether the instrument was "
        "moved (column setup) before any cause"
    )
    of_robot = np.isin([p.name for p in fit.parameters], model.geometry_names)
    tolerances = np.where(of_robot, np.abs(fit.x) / model.scales, 0.0)
    if len(tolerances) and tolerances.max() > MAX_TOLERANCES:
        k = int(tolerances.argmax())
        p = fit.parameters[k]
        return (
            f"the model does not describe these data: the fit moved {p.name} by {size_text(fit.x[k], p.unit)}, "
            f"{tolerances[k]:.0f} times its tolerance; {remedy}, or give it the tolerance that it has"
        )
    beyond = beyond_nature(calibration)
    if beyond:
        return f"the model does not describe these data: {beyond}; {remedy}"
    residual_mm, span_mm = _measured_sigma_mm(calibration), _span_mm(calibration)
    if residual_mm > MAX_SHARE_OF_SPAN * span_mm:
        left = f"the model does not describe these data: {residual_mm:.3g} mm per coordinate are left"
        points = calibration.dataset.points
        if points is not None and len(points) > 1 and not np.ptp(points.xyz_mm, axis=0).any():
            return f"{left}, since all {len(points)} points are one place, at which the joints do not hold the tool"
        return f"{left} of points that spread over {span_mm:.3g} mm; {remedy}"
    return ""


def beyond_nature(calibration: Calibration) -> str:
    """Clause that names a fitted effect far beyond its natural bound; "" where there is none."""
    fitted = calibration.fit.by_name
    for effect in calibration.model.added_effects:
        for parameter in effect.parameters:
            size, sigma = fitted.get(full_name(effect, parameter), (0.0, np.inf))
            bound = exceeded_bound(effect, parameter, size, sigma)
            if bound is not None and abs(size) - 2.0 * sigma > bound.refused * bound.size:
                return (
                    f"{full_name(effect, parameter)} came out as {size_text(size, parameter.unit)}, "
                    f"{abs(size) / bound.size:.0f} times the most that such a cause has been known to have "
                    f"({bound.size:g} {bound.unit}; {bound.source})"
                )
    return ""


def size_text(value: float, unit: str) -> str:
    """Value with its unit as text, angles in degrees: "0.35 mm", "56.7 deg"."""
    return f"{np.degrees(value):.3g} deg" if unit == "rad" else f"{value:.3g} {unit}"


def too_good(calibration: Calibration) -> str:
    """Sentence on a residual far below any realistic measurement noise; "" for other residuals.

    The noise is the declared sigma or, without one, that of the best instruments for arms.
    """
    fit, dataset = calibration.fit, calibration.dataset
    declared = dataset.declares_noise
    floor = Observations.of(dataset).noise_floor
    dof = fit.degrees_of_freedom
    if not (np.isfinite(fit.reduced_chi) and fit.reduced_chi < FAR_BELOW * floor):
        return ""
    if dof * (fit.reduced_chi / floor) ** 2 > chi2_ppf(_BY_CHANCE, dof):
        return ""
    of = "the declared sigma" if declared else f"the {BEST_SIGMA_MM:g} mm of the best instruments for arms"
    return (
        f"{calibration.sigma_mm:.2g} mm per coordinate are left, {fit.reduced_chi / floor:.2g} times {of}: no "
        "measurement is that good, so the model was fitted to itself, the points were computed, or sigma was declared "
        "far too large: declare what repeats of one pose show"
    )


def _measured_sigma_mm(calibration: Calibration) -> float:
    """Residual sigma, mm, in the measured directions (for a touched plane, its normal alone)."""
    covariance = Observations.of(calibration.fitted_dataset).covariance_mm2
    information = float(np.mean(np.trace(np.linalg.inv(covariance), axis1=-2, axis2=-1))) / 3.0
    return calibration.fit.reduced_chi / float(np.sqrt(information))


def _span_mm(calibration: Calibration) -> float:
    """RMS spread of the points per coordinate, mm, at least a fixed share of the arm's length."""
    dataset = calibration.dataset
    assert dataset.points is not None
    spread_mm = float(np.sqrt(np.mean(np.var(dataset.points.xyz_mm, axis=0))))
    lengths = [k for k, kind in enumerate(PARAMETER_KINDS) if kind in LENGTH_KINDS]
    return max(spread_mm, LEAST_SPAN_OF_REACH * float(np.abs(dataset.robot.table[:, lengths]).sum()))


def fit_without_outliers(calibration: Calibration) -> Calibration | None:
    """Robust fit to the data of a plain fit; None where no pose is outlying or the fit was robust already."""
    options = calibration.options
    if options.robust or calibration.residual == "distance":
        return None
    try:
        robust = fit_again(calibration, calibration.dataset, replace(options, robust=True))
    except FitError:
        return None
    return robust if robust.outliers else None
