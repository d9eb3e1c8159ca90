"""Covariance of fitted parameters by loads that are uncertain, as those of measured torques are.

An effect under load is fitted as if the load were known. Where the load is off, the parameters move: to first order by
-C J^T c, with the fit's covariance C over the noise's variance, its Jacobian J, and the change c of the residual.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.fitting.fit import Fit
from calib.fitting.model import Model
from calib.fitting.observations import Observations, with_nominal_scanner_frames
from calib.fitting.residual_kinds import make_residuals
from calib.kinematics.statics import uncertain_loads


def with_load_uncertainty(kind: str, model: Model, fit: Fit, observed: Observations) -> Fit:
    """Fit whose covariance has what the noise of measured torques makes of the parameters; itself without these.

    kind: of the residual.
    """
    robot = model.loads_of
    if robot is None or not robot.measured_loads or not np.isfinite(fit.reduced_chi) or not fit.reduced_chi > 0.0:
        return fit
    placed = with_nominal_scanner_frames(observed, model.placed_robot)
    at = make_residuals(kind, model, placed).linearise(fit.x)
    gain = fit.covariance / fit.reduced_chi**2 @ at.jacobian.T
    covariance = fit.covariance.copy()
    for variant in uncertain_loads(robot):
        changed = make_residuals(kind, replace(model, loads_of=variant), placed).residual(fit.x)
        moved = gain @ (changed - at.residual)
        covariance += np.outer(moved, moved)
    return replace(fit, covariance=covariance)
