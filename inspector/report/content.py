"""Content of a report, gathered from a session: fit, ranking of effects, residuals, identifiability."""

from __future__ import annotations

from dataclasses import dataclass

from calib.calibration.pose_errors import pose_errors_of
from calib.calibration.result import Calibration
from calib.compensation.correction import Correction
from calib.dataset.dataset import Dataset
from calib.dataset.files.origin import Origin
from calib.diagnosis.result import Diagnosis
from calib.identifiability.redundancy import Redundancy
from calib.models.exported_table import ExportedTable, exported_table
from calib.present.effects import model_name
from calib.present.fit.residuals import ModelResidual, residuals_of
from calib.screening.candidates import Screening
from calib.screening.residual_tests import run_residual_tests
from inspector.session.measuring import with_redundancy
from inspector.session.session import Session


@dataclass(frozen=True)
class Report:
    """All content of a report, gathered by `report_of`."""

    session: Session
    calibration: Calibration
    ranking: Screening
    ranking_of: str  # the model that the ranking is about
    # After the link errors alone, where an effect was found, then after the last fit.
    residuals: tuple[ModelResidual, ...]
    redundancy: Redundancy
    table: ExportedTable
    origin: Origin
    correction: Correction | None = None  # of the measured poses, where the model has what no table can hold

    @property
    def dataset(self) -> Dataset:
        return self.calibration.dataset

    @property
    def diagnosis(self) -> Diagnosis | None:
        return self.session.diagnosis


def report_of(session: Session) -> Report:
    """Content of the report on a session that is calibrated and whose candidates are ranked."""
    calibration, ranking, diagnosis = session.calibration, session.screening, session.diagnosis
    assert calibration is not None
    assert ranking is not None
    analysis = session.redundancy or with_redundancy(session, calibration.residual).redundancy
    assert analysis is not None
    ranked_on = calibration
    if diagnosis is not None:
        ranking, ranked_on = diagnosis.screenings[0], diagnosis.steps[0].calibration
        residuals = residuals_of(diagnosis)
    else:
        tests = session.residual_tests or run_residual_tests(calibration.dataset, ranking.projected)
        residuals = [ModelResidual(calibration, session.pose_errors or pose_errors_of(calibration), tests)]
    table = exported_table(calibration, session.links_alone)
    correction = None
    if calibration.model.arm_family_names:
        poses = calibration.dataset.poses
        correction = calibration.fitted_model.correct(poses.q, poses, ids=poses.ids)
    name, origin = model_name(ranked_on), Origin.of(session.dataset)
    return Report(session, calibration, ranking, name, tuple(residuals), analysis, table, origin, correction)
