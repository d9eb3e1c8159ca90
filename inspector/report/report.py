"""Report on a calibration: measurements, findings, their certainty, the method and program versions.

`content.report_of` gathers the results, `calib.present` makes blocks of them, `page` renders these by the templates.
"""

from __future__ import annotations

import platform
from dataclasses import asdict, replace
from datetime import datetime
from importlib import metadata
from pathlib import Path

from calib.calibration.noise_level import check_sigma
from calib.present.cause.candidates import FULL_RANKING, estimated_values, held_out_sentence, ranking, untestable_blocks
from calib.present.cause.diagnosis import (
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
from calib.present.cause.interventions import intervention_sections
from calib.present.fit.calibration import camera_sections, parameters
from calib.present.fit.dataset import measured_blocks
from calib.present.fit.errors import error_tables, history_caption, last_change, pose_errors, sigma_sentence, step_table
from calib.present.fit.learned import learned_section
from calib.present.fit.redundancy import redundancy_section
from calib.present.fit.residuals import residual_blocks
from calib.present.origins import origin_blocks
from calib.rendering.blocks import Block, Bullets, Facts, FigurePlace, Paragraph, Presentation, Section
from calib.strict_json import to_json
from inspector.report.content import Report
from inspector.report.first_page import first_page
from inspector.report.page import MARK, render

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


def report_html(report: Report, *, now: datetime) -> str:
    """HTML of a report; `now`: its date."""
    made = now.astimezone().strftime("%Y-%m-%d %H:%M %Z").strip()
    sections = [
        Section(HOW, _reasons(report)),
        *([] if report.diagnosis is None else intervention_sections(report.diagnosis)),
        Section(HISTORY, _history(report)),
        *camera_sections(report.calibration),
        Section(DATASET, measured_blocks(report.calibration, report.session.searches)),
        Section(MISSING, _ranking(report)),
        Section(RESIDUAL, residual_blocks(report.residuals)),
        *learned_section(report.calibration),
        Section(BY_POSE, [pose_errors(report.calibration)]),
        redundancy_section(report.redundancy),
        Section(PARAMETERS, parameters(report.calibration, report.table)),
        Section("Method", (Bullets(METHOD), Bullets(REFERENCES))),
        Section("Made with", [Facts(versions()), *origin_blocks(report.origin), Paragraph(f"Made {made}.", soft=True)]),
    ]
    return render(
        Presentation(f"Calibration report: {report.dataset.name}", first_page(report, made), sections),
        to_json(asdict(report.origin)),
    )


def versions() -> list[tuple[str, str]]:
    """Versions of the program and libraries that computed the figures."""
    out = [("Python", f"{platform.python_version()}, {platform.system()} {platform.machine()}")]
    for package in PACKAGES:
        try:
            out.append((package, metadata.version(package)))
        except metadata.PackageNotFoundError:  # open3d comes under one of two names
            continue
    return out


def _reasons(report: Report) -> list[Block]:
    if report.diagnosis is not None:
        return [verdict_block(report.diagnosis), *reasons(report.diagnosis, report.session.next_poses)]
    change = last_change(report.session.history)
    return [*([] if change is None else [change]), Paragraph(sigma_sentence(check_sigma(report.calibration)))]


def _history(report: Report) -> list[Block]:
    steps, caption = report.session.steps, history_caption(report.calibration)
    figure = FigurePlace("error_history", (steps,), caption)
    return [figure, step_table(steps, as_delivered=True), *error_tables(report.calibration)]


def _ranking(report: Report) -> list[Block]:
    """Blocks on the evidence of every candidate, the values of the best, and effects that cannot be tested."""
    tested = f"Each effect tested on the residual of the model of {report.ranking_of}."
    best = next((c for c in report.ranking.candidates if c.values), None)
    values: list[Block] = []
    if best is not None:
        caption = f"{best.name}: its coefficients as that ranking estimates them"
        values = [replace(estimated_values(best, report.calibration), caption=caption)]
    untestable = report.diagnosis.untestable if report.diagnosis else report.ranking.untestable
    likely = None if report.diagnosis is None else report.diagnosis.told_probabilities
    return [
        Paragraph(f"{tested} {held_out_sentence(report.ranking)}"),
        ranking(report.ranking, FULL_RANKING, mark=report.calibration.model.family_names, likely=likely),
        *values,
        *untestable_blocks(untestable),
    ]
