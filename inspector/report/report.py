"""Report on a calibration: measurements, findings, their certainty, the method and program versions.

`content.report_of` gathers what it tells, `sections` has a function a section, `page` renders them by the templates.
"""

from __future__ import annotations

import platform
from datetime import datetime
from importlib import metadata
from pathlib import Path

from calib.calibration.noise_level import check_sigma, noise_level
from calib.present.blocks import (
    Block,
    Bullets,
    Facts,
    Paragraph,
    Section,
    Verdict,
)
from calib.present.calibration import error_tables, parameters, pose_errors, sigma_sentence, step_table
from calib.present.dataset import measured_blocks
from calib.present.diagnosis import HOW, reasons
from calib.present.redundancy import redundancy_section
from inspector.figures.plots import error_history
from inspector.markup.learn.effects import last_change
from inspector.report import sections
from inspector.report.content import Report
from inspector.report.figure_block import Figure
from inspector.report.first_page import first_page
from inspector.report.page import MARK, render_page

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
HISTORY = "Error history"
PACKAGES = ("robot-calibration-inspector", "numpy", "scipy", "pandas", "open3d-cpu", "open3d", "plotly")


def is_report(path: Path) -> bool:
    """Whether a file is a report of this program, or empty, so that it may be replaced."""
    with path.open("rb") as file:
        start = file.read(2000)
    return not start or MARK.encode() in start


def report_html(report: Report, *, now: datetime) -> str:
    """HTML of a report; `now` is its date."""
    made = now.astimezone().strftime("%Y-%m-%d %H:%M %Z").strip()
    return render_page(
        f"Calibration report: {report.dataset.name}",
        first_page(report, made),
        (
            *finding_sections(report),
            Section("Method", (Bullets(METHOD), Bullets(REFERENCES))),
            Section("Made with", (Facts(versions()), Paragraph(f"Made {made}.", soft=True))),
        ),
    )


def finding_sections(report: Report) -> tuple[Section, ...]:
    """Sections on all findings after the first page, used by the report and by a notebook's view of a diagnosis."""
    residuals = [block for model in report.residuals for block in sections.model_residual(report, model)]
    curves = sections.learned_curves(report)
    return (
        Section(HOW, _reasons(report)),
        Section(HISTORY, _history(report)),
        Section("Dataset and how it was measured", measured_blocks(report.calibration, report.session.searches)),
        Section("What could be missing", sections.ranking(report)),
        Section("Where the model is off", residuals),
        *([Section("Learned curves of the joints", curves)] if curves else []),
        Section("Residual by pose", [pose_errors(report.calibration)]),
        redundancy_section(report.redundancy),
        Section("Parameters", parameters(report.calibration, report.table)),
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
        return list(reasons(report.diagnosis, report.session.next_poses))
    sentence, colour = last_change(report.session.history)
    return [
        *([Verdict(sentence, colour)] if sentence else []),
        Paragraph(sigma_sentence(check_sigma(report.calibration))),
    ]


def _history(report: Report) -> list[Block]:
    steps = report.session.history
    level = noise_level(report.calibration)
    labels = [step.label for step in steps]
    train, test = [s.train_rmse_mm for s in steps], [s.test_rmse_mm for s in steps]
    drawn = error_history(labels, train, test, level.floor_mm, noise=level.name)
    caption = f"3D RMSE of training and test poses after each change of the model; dashed: what {level.name} leaves."
    table = step_table([(s.label, s.train_rmse_mm, s.test_rmse_mm, s.sigma_mm) for s in steps])
    return [Figure(drawn, caption), table, *error_tables(report.calibration)]
