"""What was found, as a notebook shows it without figures: a calibration, a diagnosis, which parameters can be known."""

from __future__ import annotations

import math

from calib.calibration.result import Calibration
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.words.conclusion_text import verdict_text
from calib.diagnosis.words.headline import headline_note, headline_of, noise_words
from calib.diagnosis.words.phrases import capitalised, untestable_texts
from calib.diagnosis.words.text import explanation_text, reason_texts
from calib.identifiability.redundancy import Redundancy
from calib.planning.discrimination import explanation_of, next_poses
from calib.present.blocks import (
    Block,
    Bullets,
    Facts,
    Headline,
    KeyFigures,
    Paragraph,
    Section,
    Table,
    Verdict,
)
from calib.present.colours import BAD, VERDICT_COLOURS
from calib.present.numbers import readable
from calib.views.view_page import view_html

_FIGURES = (("RMS", "rmse_mm"), ("mean", "mean_mm"), ("maximum", "max_mm"))
_RANKED = 12
_PLACES = 9  # of a parameter's value, beyond which there is rounding alone


def calibration_html(calibration: Calibration) -> str:
    """A calibration as HTML: the error before and after, what to be warned of, the parameters."""
    sections = [Section("Parameters", parameters(calibration))]
    return view_html(f"Calibration of {calibration.dataset.name}", calibration_head(calibration), sections)


def calibration_head(calibration: Calibration) -> list[Block]:
    """The errors, and what to be warned of."""
    fit, model = calibration.fit, " + ".join(["link errors", *calibration.model.family_names])
    head: list[Block] = [way(calibration), errors(calibration)]
    if calibration.worse_than_nominal:
        head.insert(1, Verdict(capitalised(calibration.worse_than_nominal), BAD))
    facts: list[tuple[str, object]] = [
        ("model", model),
        ("residual", f"{calibration.residual}, {fit.rows} equations"),
        ("parameters", f"{len(fit.parameters)}, of which {fit.rank} can be told apart"),
        ("ended", fit.reason),
    ]
    told = [words for words in calibration.warnings if words != calibration.worse_than_nominal]
    return [*head, KeyFigures(facts), *([Bullets(told)] if told else [])]


def way(*calibrations: Calibration) -> Headline:
    """From the arm as delivered to the last of the fits, as the page's headline."""
    told = headline_of(calibrations)
    stages = [(told.shown(stage.error_mm), stage.name) for stage in told.stages]
    return Headline(stages, noise_words(told), headline_note(told), told.reached_noise)


def errors(calibration: Calibration) -> Table:
    """RMS, mean and maximum of the 3D error before and after, of training and of test poses."""
    rows = [
        (f"{role} poses, {name}", *(f"{getattr(figures, key):.4f}" for figures in (before, after)))
        for role, before, after in (
            ("training", calibration.before.train, calibration.after.train),
            ("test", calibration.before.test, calibration.after.test),
        )
        if before is not None and after is not None
        for name, key in _FIGURES
    ]
    return Table(("3D error, mm", "before", "after"), rows)


def parameters(calibration: Calibration) -> list[Block]:
    """Every parameter with its sigma; angles in degrees, as the files have them."""
    rows = []
    for row in calibration.to_frame().to_dict(orient="records"):
        unit = row["unit"]
        nominal, value, change, sigma = (
            round(readable(row[key], unit)[0], _PLACES) + 0.0 for key in ("nominal", "value", "change", "sigma")
        )
        name = f"{row['name']}{'' if row['known'] else '*'}"
        shown = (f"{nominal:.6g}", f"{value:.6g}", f"{change:+.3g}", f"{sigma:.2g}")
        rows.append((name, *shown, readable(0.0, unit)[1]))
    note = "* the data tell next to nothing of it by itself: its tolerance holds the value, or it is shared."
    columns = ("name", "nominal", "fitted", "change", "sigma", "unit")
    return [Table(columns, rows, left=(0, 5)), Paragraph(note, soft=True)]


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
        way(*(step.calibration for step in diagnosis.steps)),
        Verdict(words, VERDICT_COLOURS[diagnosis.verdict]),
    ]


def redundancy_html(redundancy: Redundancy) -> str:
    """Which parameters act alike, and how many can be known."""
    return view_html("Which parameters can be known", redundancy_head(redundancy))


def redundancy_head(redundancy: Redundancy) -> list[Block]:
    """The counts, and a sentence for each group that acts together."""
    rows: list[tuple[str, object]] = [
        ("parameters", len(redundancy.parameters)),
        ("independent (rank)", redundancy.rank),
        ("carry all the information", ", ".join(redundancy.independent)),
    ]
    return [Facts(rows), Bullets(redundancy.relations())]


def _digits(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "–"
