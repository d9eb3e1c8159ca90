"""HTML of the tab Fit on a calibration: errors before and after, parameters."""

from __future__ import annotations

from calib.calibration.result import Calibration
from calib.models.exported_table import exported_table
from calib.present.fit.calibration import calibration_warnings, fit_facts, parameter_tables
from calib.present.fit.corners import face_labelling
from calib.present.fit.errors import error_tables, table_alone
from calib.present.references import Names
from calib.rendering import html
from calib.rendering.blocks import Block, Facts, Verdict
from calib.rendering.colours import DOUBT
from inspector.markup.parts.palette import ROLE_COLOURS
from inspector.session.measuring import measured_kinds, no_full_poses
from inspector.session.session import Session

NO_POSES = "pose cannot be fitted: "


def faces_words(session: Session) -> str:
    """Sentence on the orientations available for a fit of full poses, or on what such a fit lacks."""
    if session.unlabelled:
        return "pose needs the jig's faces named in the scans, which is done once their corners are found."
    if "pose" not in measured_kinds(session):
        if session.dataset.points is None:
            return "Full poses are not offered: what is scanned is no jig with three faces."
        return "Full poses are not offered: points.csv has no orientations (qw, qx, qy, qz)."
    problem = no_full_poses(session)
    if problem:
        return NO_POSES + problem.removeprefix(f"dataset {session.dataset.name}: ")
    if session.face_labels is not None:
        return f"pose can be fitted: {face_labelling(session.face_labels.labelling)}."
    return "pose can be fitted: points.csv has orientations."


def what_is_fitted(result: Calibration) -> str:
    """Name of the error that the figures show."""
    return "distance" if result.residual == "distance" else "3D"


def fit_html(result: Calibration) -> str:
    """HTML on the kind of fit, on how it ended, and on its warnings."""
    alerts = [Verdict(words, DOUBT) for words in calibration_warnings(result)]
    return html.panel([Facts(fit_facts(result)), *alerts], Names.of(result.dataset))


def errors_html(session: Session, result: Calibration) -> str:
    """HTML of the errors before and after calibration, and of the errors with robot.toml's table alone."""
    alone: list[Block] = []
    if session.calibration is not None and session.links_alone is not None:
        alone = table_alone(exported_table(session.calibration, session.links_alone))
    return html.panel([*error_tables(result, ROLE_COLOURS), *alone])


def parameters_html(result: Calibration) -> str:
    """HTML tables of the parameters, in which a click on a row selects its joint."""
    return html.panel(parameter_tables(result, height="420px"))
