"""Whether a fit is plausible at all: wrong units, joint signs or order of poses are no calibration errors."""

from __future__ import annotations

import numpy as np

from calib.calibration.result import Calibration

MAX_TOLERANCES = 100.0
"""Largest plausible correction, in tolerances: 100 mm and 50 deg by default."""
MAX_SHARE_OF_SPAN = 0.02
"""Largest plausible residual sigma, as a share of the RMS spread of the points, whatever effect is missing."""


def implausibility_reason(calibration: Calibration) -> str:
    """Why the data cannot be of this arm, in a sentence; "" where they can.

    Either the residual is too large, or a correction is far beyond its tolerance: one point reported for all poses, for
    example, is fitted exactly by links without length.
    """
    assert calibration.dataset.points is not None
    fit, xyz_mm = calibration.fit, calibration.dataset.points.xyz_mm
    remedy = "check units, joint signs, the order of the poses and robot.toml before any cause"
    tolerances = np.abs(fit.x) / calibration.model.scales
    if len(tolerances) and tolerances.max() > MAX_TOLERANCES:
        k = int(tolerances.argmax())
        p = fit.parameters[k]
        return (
            f"the model does not describe these data: the fit moved {p.name} by {fit.x[k]:.3g} {p.unit}, "
            f"{tolerances[k]:.0f} times its tolerance; {remedy}"
        )
    span_mm = float(np.sqrt(np.mean(np.var(xyz_mm, axis=0))))  # a coordinate, as the residual's sigma
    if calibration.sigma_mm > MAX_SHARE_OF_SPAN * span_mm:
        return (
            f"the model does not describe these data: {calibration.sigma_mm:.3g} mm a coordinate are left of points "
            f"that spread over {span_mm:.3g} mm; {remedy}"
        )
    return ""
