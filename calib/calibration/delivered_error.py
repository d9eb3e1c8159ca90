"""Error that a calibration predicts for the arm as delivered, at poses where nothing was measured.

Both predictions stand in the measuring device's frame, as in every evaluation: the arm as delivered by the frame that
fits it best, the calibrated arm by its own. Noise of the measured points moves both frames alike, so the difference is
as uncertain as the fitted parameters are, the calibrated arm's frame moving with them, and by what the model is known
to miss (`calib.calibration.promise`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.promise import missed_variance
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import JointKnowledge
from calib.dataset.dataset import Poses
from calib.errors import FitError
from calib.fitting.observations import Observations
from calib.fitting.scanner_frame import frame_motion


@dataclass(frozen=True)
class DeliveredError:
    """Predicted error of an arm as delivered at N poses: delivered minus calibrated, in the calibrated base's frame."""

    error_mm: Array  # (N, 3)
    covariance_mm2: Array  # (N, 3, 3) by the fitted parameters and what the model is known to miss; no noise

    @property
    def length_mm(self) -> Array:
        """Length (N,) of the predicted error, mm."""
        return np.asarray(np.linalg.norm(self.error_mm, axis=1))

    @property
    def sigma_mm(self) -> Array:
        """Standard deviation (N,) along the predicted error, mm; the largest of any direction where it is zero."""
        length = self.length_mm[:, None]
        along = np.divide(self.error_mm, length, out=np.zeros_like(self.error_mm), where=length > 0.0)
        variance = np.einsum("ni,nij,nj->n", along, self.covariance_mm2, along)
        largest = np.linalg.eigvalsh(self.covariance_mm2)[:, -1]
        return np.asarray(np.sqrt(np.maximum(np.where(length[:, 0] > 0.0, variance, largest), 0.0)))


def delivered_error(calibration: Calibration, poses: Poses, setup: str) -> DeliveredError:
    """Predicted error of the arm as delivered, with its standard deviation, at poses that need not be measured.

    It is that of the tool point, or of the first target where the tool point was not measured.

    Args:
        calibration: a fit of an arm that does not carry the scanner.
        poses: N poses, with the conditions that the model's effects depend on.
        setup: placement of the measuring device by whose frames the two arms are compared.

    Raises:
        FitError: a scanner on the flange, or a setup without a frame.

    >>> import calib
    >>> from calib.calibration.delivered_error import delivered_error
    >>> fit = calib.calibrate("sample_data/hidden_effect_a")
    >>> poses = fit.dataset.poses.select([0, 1])
    >>> delivered_error(fit, poses, str(poses.setup[0])).error_mm.shape
    (2, 3)
    """
    model, x = calibration.model, calibration.fit.x
    if model.robot.carries_scanner:
        raise FitError("the arm carries the scanner: its error is not that of a tool point")
    delivered, calibrated = (at.scanner_T_base.get(setup) for at in (calibration.before, calibration.after))
    if delivered is None or calibrated is None:
        raise FitError(f"setup {setup!r} has no measured points; there are {sorted(calibration.after.scanner_T_base)}")
    target = Observations.of(calibration.fitted_dataset).first_target
    fitted_mm = model.predict(x, poses, target)
    delivered_mm = model.predict(model.delivered(x), poses, target)
    base_T_delivered = frames.invert(calibrated) @ delivered
    error_mm = frames.apply(base_T_delivered, delivered_mm) - fitted_mm
    missed = missed_variance(calibration, poses.q)[:, None, None] * np.eye(3)
    return DeliveredError(error_mm, delivered_error_covariance(calibration, poses, setup, target) + missed)


def delivered_error_covariance(calibration: Calibration, poses: Poses, setup: str, target: str) -> Array:
    """Covariance of the predicted error of the arm as delivered, by the fitted parameters alone.

    With J the derivative of the calibrated point by the parameters x, G that by the frame of the setup, and F the
    derivative by which the frame follows the parameters (`JointKnowledge.follows`): (J + G F) cov(x) (J + G F)^T.
    A parameter that the fit leaves without a bound counts with its tolerance.

    Args:
        calibration: a fit of P parameters.
        poses: N poses.
        setup: placement of the measuring device, with training points.
        target: name of the predicted target.

    Returns:
        (N, 3, 3) mm^2, in the calibrated base's frame; noise of a measurement is not in it.
    """
    model, fit = calibration.model, calibration.fit
    unbounded = np.where(np.isfinite(fit.sigma), 0.0, model.scales**2)
    covariance = np.where(np.isfinite(fit.covariance), fit.covariance, 0.0) + np.diag(unbounded)
    known = JointKnowledge.of(calibration, setup)
    scanner_T_base = calibration.after.scanner_T_base[setup]
    points_mm, by_x = model.linearise(fit.x, poses, target)
    motion = frame_motion(frames.apply(scanner_T_base, points_mm), known.centre_mm)  # (N, 3, 6), scanner frame
    rows = by_x + scanner_T_base[:3, :3].T @ (motion @ known.follows)
    return np.asarray(rows @ covariance @ np.swapaxes(rows, 1, 2))
