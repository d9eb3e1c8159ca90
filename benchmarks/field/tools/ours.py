"""This project: the fit of the links alone ("links"), and the diagnosis that adds what is missing ("diagnosed")."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from problem import Answer, Problem

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

import calib
from calib.dataset.repeats import without_poses
from calib.models.fitted_model import FittedModel


def calibrate(problem: Problem, folder: Path, variant: str) -> Answer:
    """The variant's answer, in the frame of the instrument, with what it promises for each coordinate."""
    dataset = calib.load_dataset(folder / "dataset")
    assert dataset.points is not None
    poses, cause = dataset.poses, ""
    trained = without_poses(dataset, [poses.ids[i] for i in np.flatnonzero(poses.is_test)])
    if variant == "links":
        fit = calib.calibrate(trained)
    else:
        diagnosis = calib.diagnose(trained)
        fit, told = diagnosis.calibration, list(diagnosis.missing)
        cause = f"{diagnosis.verdict}: {', '.join(told) or 'no name'}"
    model = FittedModel.of(fit)
    promised = model.promise(dataset, model.evaluate(dataset))
    return Answer(
        dataset.points.xyz_mm - promised.error_mm,
        len(fit.fit.x),
        fit.fit.reason,
        cause,
        promised.sigma_mm,
        calib.__version__,
    )
