"""Report on a calibration: measurements, findings, their certainty, the method and program versions.

`calib.present` makes blocks of the results of a session, `page` renders these by the templates.
"""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from importlib import metadata
from pathlib import Path

from calib.calibration.model_versions import model_name
from calib.calibration.noise_level import check_sigma
from calib.calibration.pose_errors import pose_errors_of
from calib.calibration.result import Calibration
from calib.dataset.files.origin import Origin
from calib.diagnosis.effect_selection import FitStep
from calib.models.exported_table import exported_table
from calib.present.diagnosis.candidates import (
    FULL_RANKING,
    estimated_values,
    held_out_sentence,
    ranking,
    untestable_blocks,
)
from calib.present.diagnosis.diagnosis import (
    BY_POSE,
    DATASET,
    HISTORY,
    HOW,
    MISSING,
    PARAMETERS,
    RESIDUAL,
    reasons,
    verdict_block,
)
from calib.present.diagnosis.interventions import intervention_sections
from calib.present.fit.calibration import camera_sections, parameters
from calib.present.fit.dataset import measured_blocks
from calib.present.fit.errors import error_tables, history_caption, last_change, pose_errors, sigma_sentence, step_table
from calib.present.fit.learned import learned_section
from calib.present.fit.redundancy import redundancy_section
from calib.present.fit.residuals import ModelResidual, residual_blocks, residuals_of
from calib.present.origins import origin_blocks
from calib.rendering.blocks import Block, Bullets, Facts, FigurePlace, Paragraph, Presentation, Section
from calib.screening.residual_tests import run_residual_tests
from inspector.report.first_page import first_page
from inspector.report.page import MARK, render
from inspector.session.measuring import with_redundancy
from inspector.session.session import Session

METHOD = (
    "Frame i of the arm is Rz(theta_i + q_i) Trans(a_i, 0, d_i) Rx(alpha_i) Ry(beta_i); a tool row of the same form "
    "without q ends the chain.",
    "Measured points and predicted ones meet in the instrument's frame, whose place is unknown and solved for in "
    "closed form at every step. Training poses are fitted by least squares, each point weighted by its covariance; "
    "parameters are held within about 1 mm and 0.5° of their nominal value, which exact data overrule. Test poses "
    "are only predicted.",
    "An effect is named only if it beats noise (F test, Holm's correction, p below 0.01, and log evidence above 3), "
    "leads the next by a log Bayes factor above 3, and does not make the test poses worse. What is left at the end "
    "is tested for a systematic dependence on every input, corrected for all that was looked at (Westfall and Young); "
    "where more than noise is left, the effects in the model are suspected, not claimed.",
    "A parameter's sigma assumes a complete model: where more than noise is left, it is too small.",
)
REFERENCES = (
    "Jang et al. 2025, Robot Kinematic Calibration Using a 3D Scanner (the five-parameter model, distances).",
    "Park et al. 2022, Kinematic Calibration Based on Position of Robot Manipulator Eliminating Redundancy of "
    "Parameters, JKSPE 39(7) 517-528, doi 10.7736/JKSPE.022.023 (redundancy).",
)
PACKAGES = ("robot-calibration-inspector", "numpy", "scipy", "pandas", "open3d-cpu", "open3d", "plotly")


def is_report(path: Path) -> bool:
    """Whether a file is a report of this program, or empty, so that it may be replaced."""
    with path.open("rb") as file:
        start = file.read(2000)
    return not start or MARK.encode() in start


def report_html(session: Session, *, now: datetime) -> str:
    """HTML of the report on a session that is calibrated and whose candidates are ranked; `now`: its date."""
    calibration, diagnosis = session.calibration, session.diagnosis
    assert calibration is not None
    made = now.astimezone().strftime("%Y-%m-%d %H:%M %Z").strip()
    table = exported_table(calibration, session.links_alone)
    analysis = session.redundancy or with_redundancy(session, calibration.residual).redundancy
    assert analysis is not None
    origin = origin_blocks(Origin.of(session.dataset))
    sections = [
        Section(HOW, _reasons(session, calibration)),
        *([] if diagnosis is None else intervention_sections(diagnosis)),
        Section(HISTORY, _history(session.steps)),
        *camera_sections(calibration),
        Section(DATASET, measured_blocks(calibration, session.searches)),
        Section(MISSING, _ranking(session, calibration)),
        Section(RESIDUAL, residual_blocks(_residuals(session, calibration))),
        *learned_section(calibration),
        Section(BY_POSE, [pose_errors(calibration)]),
        redundancy_section(analysis),
        Section(PARAMETERS, parameters(calibration, table)),
        Section("Method", (Bullets(METHOD), Bullets(REFERENCES))),
        Section("Made with", [Facts(versions()), *origin, Paragraph(f"Made {made}.", soft=True)]),
    ]
    first = first_page(session, calibration, table, made)
    return render(Presentation(f"Calibration report: {calibration.dataset.name}", first, sections))


def versions() -> list[tuple[str, str]]:
    """Versions of the program and libraries that computed the figures."""
    out = [("Python", f"{platform.python_version()}, {platform.system()} {platform.machine()}")]
    for package in PACKAGES:
        try:
            out.append((package, metadata.version(package)))
        except metadata.PackageNotFoundError:  # open3d comes under one of two names
            continue
    return out


def _reasons(session: Session, calibration: Calibration) -> list[Block]:
    if session.diagnosis is not None:
        return [verdict_block(session.diagnosis), *reasons(session.diagnosis, session.next_poses)]
    change = last_change(session.history)
    return [*([] if change is None else [change]), Paragraph(sigma_sentence(check_sigma(calibration)))]


def _history(steps: Sequence[FitStep]) -> list[Block]:
    last = steps[-1].calibration
    figure = FigurePlace("error_history", (steps,), history_caption(last))
    return [figure, step_table(steps, as_delivered=True), *error_tables(last)]


def _residuals(session: Session, calibration: Calibration) -> list[ModelResidual]:
    """Residuals after the link errors alone, where an effect was found, and after the last fit."""
    if session.diagnosis is not None:
        return residuals_of(session.diagnosis)
    assert session.screening is not None
    tests = session.residual_tests or run_residual_tests(calibration.dataset, session.screening.projected)
    return [ModelResidual(calibration, session.pose_errors or pose_errors_of(calibration), tests)]


def _ranking(session: Session, calibration: Calibration) -> list[Block]:
    """Blocks on the evidence of every candidate, the values of the best, and effects that cannot be tested."""
    found, ranked, likely = session.screening, calibration, None
    assert found is not None
    untestable = found.untestable
    if (diagnosis := session.diagnosis) is not None:
        found, ranked, likely = diagnosis.screenings[0], diagnosis.steps[0].calibration, diagnosis.told_probabilities
        untestable = diagnosis.untestable
    best = next((c for c in found.candidates if c.values), None)
    values: list[Block] = []
    if best is not None:
        caption = f"{best.name}: its coefficients as that ranking estimates them"
        values = [replace(estimated_values(best, calibration), caption=caption)]
    tested = f"Each effect tested on the residual of the model of {model_name(ranked.model)}."
    return [
        Paragraph(f"{tested} {held_out_sentence(found)}"),
        ranking(found, FULL_RANKING, mark=calibration.model.family_names, likely=likely),
        *values,
        *untestable_blocks(untestable),
    ]
