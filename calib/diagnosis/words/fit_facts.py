"""Facts of fits that the sentences of a diagnosis tell: errors, values, how far test poses are off."""

from __future__ import annotations

import numpy as np

from calib.calibration.result import Calibration, is_declared
from calib.diagnosis.words.phrases import meaning
from calib.diagnosis.words.sentences import ErrorChange, FittedValue, ModelFitted
from calib.effects.effect import exceeded_bound, parameters_by_name
from calib.screening.candidates import Candidate


def model_fitted(calibration: Calibration) -> ModelFitted:
    """The model that a diagnosis began with, and how far it is off."""
    fit, dataset = calibration.fit, calibration.dataset
    train, test = calibration.after.train, calibration.after.test
    return ModelFitted(
        robot=dataset.robot.name,
        families=calibration.model.family_names,
        points=train.points if train else 0,
        sigma_mm=calibration.sigma_mm,
        noise_ratio=fit.reduced_chi if is_declared(dataset) else None,
        train_rmse_mm=train.rmse_mm if train and test else None,
        test_rmse_mm=test.rmse_mm if train and test else None,
        repeats=calibration.repeat_count,
        instrument="scanner" if dataset.shows_faces else "instrument",
    )


def visible_mm(candidate: Candidate, before: Calibration) -> float | None:
    """RMS over the training poses of what an effect explains of the 3D errors that a fit left over."""
    train = before.after.train
    return None if train is None else train.rmse_mm * float(np.sqrt(max(candidate.explained_share, 0.0)))


def error_change(before: Calibration, after: Calibration) -> ErrorChange | None:
    """How the test poses' error changes from one fit to the next; without test poses, the training poses' error."""
    if before.after.test is not None and after.after.test is not None:
        return ErrorChange(True, before.after.test.rmse_mm, after.after.test.rmse_mm)
    if before.after.train is not None and after.after.train is not None:
        return ErrorChange(False, before.after.train.rmse_mm, after.after.train.rmse_mm)
    return None


def fitted_values(candidate: Candidate, calibration: Calibration) -> tuple[FittedValue, ...]:
    """The fitted parameters that are known to better than half their size, the surest first."""
    parameters = parameters_by_name(candidate.members)
    fit = calibration.fit
    fitted = {p.name: (x, s) for p, x, s in zip(fit.parameters, fit.x, fit.sigma, strict=True)}
    out = []
    for value in candidate.values:
        size, sigma = map(float, fitted.get(value.name, (0.0, np.inf)))
        if abs(size) > 2.0 * sigma:
            means = meaning(*parameters[value.name], size, calibration)
            bound = exceeded_bound(*parameters[value.name], size, sigma)
            out.append(FittedValue(value.name, size, sigma, value.unit, means, bound))
    return tuple(sorted(out, key=lambda v: (abs(v.value) / v.sigma, v.name), reverse=True))
