"""Content of a report, gathered from a session: fit, ranking of effects, residuals, identifiability."""

from __future__ import annotations

from dataclasses import dataclass

from calib.calibration.pose_errors import PoseErrors, pose_errors_of
from calib.calibration.result import Calibration
from calib.compensation.target_correction import Correction
from calib.dataset.dataset import Dataset
from calib.diagnosis.result import Diagnosis
from calib.identifiability.redundancy import Redundancy
from calib.models.exported_table import ExportedTable, exported_table
from calib.screening.candidates import Screening
from calib.screening.residual_tests import ResidualTests, run_residual_tests
from inspector.session.measuring import with_redundancy
from inspector.session.session import Session


@dataclass(frozen=True)
class ModelResidual:
    """Residual of one model's fit: the errors of the poses, and their tests against every input."""

    title: str  # the model, see `model_name`
    pose_errors: PoseErrors
    residual_tests: ResidualTests


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
    correction: Correction | None = None  # of the measured poses, where the model has what no table can hold

    @property
    def dataset(self) -> Dataset:
        return self.calibration.dataset

    @property
    def diagnosis(self) -> Diagnosis | None:
        return self.session.diagnosis


def report_of(session: Session) -> Report:
    """Content of the report on a session that is calibrated and whose candidates are ranked."""
    calibration, ranking = session.calibration, session.screening
    assert calibration is not None
    assert ranking is not None
    analysis = session.redundancy or with_redundancy(session, calibration.residual).redundancy
    assert analysis is not None
    model = model_name(calibration)
    found = session.diagnosis
    residual_tests = session.residual_tests or run_residual_tests(calibration.dataset, ranking.projected)
    residuals = [ModelResidual(model, session.pose_errors or pose_errors_of(calibration), residual_tests)]
    ranking_of = model
    if found is not None:
        first = found.steps[0]
        ranking, ranking_of = found.screenings[0], model_name(first.calibration)
        if len(found.steps) > 1:
            before = run_residual_tests(first.calibration.dataset, ranking.projected)
            residuals.insert(0, ModelResidual(ranking_of, pose_errors_of(first.calibration), before))
    table = exported_table(calibration, session.links_alone)
    correction = None
    if calibration.model.family_names:
        poses = calibration.dataset.poses
        correction = calibration.fitted_model.correct(poses.q, poses, ids=poses.ids)
    return Report(session, calibration, ranking, ranking_of, tuple(residuals), analysis, table, correction)


def model_name(calibration: Calibration) -> str:
    """Name of a model by its content: "link errors + backlash"."""
    return " + ".join(["link errors", *calibration.model.family_names])
