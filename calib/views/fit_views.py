"""What was found, as a notebook shows it without figures: a calibration, which parameters can be known."""

from __future__ import annotations

from calib.calibration.result import Calibration
from calib.diagnosis.headline import headline_of
from calib.identifiability.redundancy import Redundancy
from calib.present.blocks import (
    Block,
    Bullets,
    Facts,
    KeyFigures,
    Section,
    Table,
    Verdict,
)
from calib.present.calibration import parameters
from calib.present.colours import BAD
from calib.present.error_headline import error_headline
from calib.present.numbers import capitalised
from calib.views.view_page import view_html

_FIGURES = (("RMS", "rmse_mm"), ("mean", "mean_mm"), ("maximum", "max_mm"))


def calibration_html(calibration: Calibration) -> str:
    """A calibration as HTML: the error before and after, what to be warned of, the parameters."""
    sections = [Section("Parameters", parameters(calibration))]
    return view_html(f"Calibration of {calibration.dataset.name}", calibration_head(calibration), sections)


def calibration_head(calibration: Calibration) -> list[Block]:
    """The errors, and what to be warned of."""
    fit, model = calibration.fit, " + ".join(["link errors", *calibration.model.family_names])
    head: list[Block] = [error_headline(headline_of([calibration])), errors(calibration)]
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
