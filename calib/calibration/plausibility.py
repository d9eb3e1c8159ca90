"""Do points, poses and table belong to one arm at all? A wrong unit, order or sign is no calibration error."""

from __future__ import annotations

import numpy as np

from calib.calibration.result import Calibration

MAX_TOLERANCES = 100.0
"""No arm has a length or an angle this many tolerances (100 mm, 50 deg) from its nominal value."""
MAX_SHARE_OF_SPAN = 0.02
"""Nor does a calibrated one err by this share of the space that its points span, whatever effect is missing."""


def implausibility_reason(calibration: Calibration) -> str:
    """What says that the data are not of this arm, in words; "" where nothing does.

    Large residuals say so, and corrections that the points forced far beyond what their tolerances allow: one point
    reported again and again is fitted without any residual by links of no length.
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
