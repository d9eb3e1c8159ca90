"""Whether a fit is plausible at all: wrong units, joint signs or order of poses are no calibration errors.

And whether single poses bend it, which a robust fit would leave out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.calibration.calibrate import calibrate
from calib.calibration.result import Calibration, outlier_words
from calib.errors import FitError

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
    remedy = (
        "check units, joint signs, the order of the poses, robot.toml, and whether the instrument was "
        "moved (column setup) before any cause"
    )
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


def outlier_hint(calibration: Calibration) -> str:
    """Which poses stand out of a fit that was not robust, and what it is without them; "" where none does."""
    options, model = calibration.options, calibration.model
    if options.robust or calibration.residual == "distance":
        return ""
    try:
        robust = calibrate(
            calibration.dataset,
            replace(options, robust=True),
            effects=model.added_effects,
            prior_sigmas=model.prior_sigmas,
            start=calibration,
        )
    except FitError:
        return ""
    if not robust.outliers:
        return ""
    change = f"a coordinate's sigma is {robust.sigma_mm:.3g} mm without, {calibration.sigma_mm:.3g} mm with"
    before, after = calibration.after.test, robust.after.test
    if before is not None and after is not None:
        change = f"the test poses are off by {after.rmse_mm:.3g} mm without, {before.rmse_mm:.3g} mm with"
    it = "it" if len(robust.outliers) == 1 else "them"
    return (
        f"{outlier_words(robust)}: {change} {it} in the fit. Look at {it}; --robust leaves {it} out, --leave-out any "
        "pose"
    )
