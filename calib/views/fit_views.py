"""What was found, as a notebook shows it without figures: a calibration, a diagnosis."""

from __future__ import annotations

import math

from calib.diagnosis.result import Diagnosis
from calib.diagnosis.words.conclusion_text import verdict_text
from calib.diagnosis.words.phrases import capitalised, untestable_texts
from calib.diagnosis.words.text import explanation_text, reason_texts
from calib.planning.discrimination import explanation_of, next_poses
from calib.present.blocks import (
    Block,
    Bullets,
    Paragraph,
    Section,
    Table,
    Verdict,
)
from calib.present.calibration import error_way, parameters
from calib.present.colours import VERDICT_COLOURS
from calib.views.view_page import view_html

_FIGURES = (("RMS", "rmse_mm"), ("mean", "mean_mm"), ("maximum", "max_mm"))
_RANKED = 12
_PLACES = 9  # of a parameter's value, beyond which there is rounding alone


def diagnosis_summary(diagnosis: Diagnosis) -> str:
    """A diagnosis in words: several short paragraphs, the verdict last."""
    return explanation_text(explanation_of(diagnosis, next_poses(diagnosis)))


def diagnosis_html(diagnosis: Diagnosis) -> str:
    """A diagnosis as HTML: how the error fell, the verdict, the steps; why, the ranking, the last fit's parameters."""
    shown = ("train_rmse_mm", "test_rmse_mm", "sigma_mm", "margin")
    rows = [
        (step["effect"], *(_digits(step[key]) for key in shown))
        for step in diagnosis.to_frame().to_dict(orient="records")
    ]
    columns = ("model", "training, mm", "test, mm", "residual sigma, mm", "lead in log evidence")
    ranked = [
        (c.name, f"{c.log_evidence:.1f}", f"{c.p_holm:.2g}", f"{100 * c.explained_share:.0f}")
        for c in diagnosis.candidates[:_RANKED]
    ]
    explanation = explanation_of(diagnosis, next_poses(diagnosis))
    why = [Paragraph(words.replace("+-", "±")) for words in reason_texts(explanation)]
    sections = [
        Section("How the verdict was reached", why),
        Section("What could be missing", [
            Table(("effect", "log evidence", "p (Holm)", "explains, %"), ranked),
            *([Paragraph("Cannot be tested with these data:")] if diagnosis.untestable else []),
            Bullets(untestable_texts(diagnosis.untestable)),
        ]),
        Section("Parameters", parameters(diagnosis.calibration)),
    ]  # fmt: skip
    head = [*diagnosis_head(diagnosis), Table(columns, rows, caption="3D RMSE after each step")]
    return view_html(f"Diagnosis of {diagnosis.calibration.dataset.name}", head, sections)


def diagnosis_head(diagnosis: Diagnosis) -> list[Block]:
    """The way of the error and the verdict."""
    words = capitalised(verdict_text(diagnosis.explanation.verdict, reasons="below"))
    return [
        error_way(*(step.calibration for step in diagnosis.steps)),
        Verdict(words, VERDICT_COLOURS[diagnosis.verdict]),
    ]


def _digits(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "–"
