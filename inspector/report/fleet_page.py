"""A fleet as one page: what arms share, which changed, the worst, what failed, and every dataset in a line."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from urllib.parse import quote

from calib.diagnosis.words.phrases import length_text
from calib.fleet.drift import Drift
from calib.fleet.result import Fleet
from calib.fleet.row import Row
from calib.present import numbers
from calib.present.blocks import (
    Block,
    Bullets,
    Facts,
    KeyFigures,
    Link,
    Paragraph,
    Section,
    Table,
    Verdict,
)
from inspector.figures.fleet_plots import fleet_errors
from inspector.markup.parts.palette import BAD, DOUBT, GOOD
from inspector.report.figure_block import Figure
from inspector.report.page import render_page
from inspector.report.report import versions

METHOD = (
    "Each dataset is judged by itself as inspector check does: corners, fit, diagnosis. An error is the 3D RMSE of the "
    "test poses, which no fit saw, or of the fitted poses where there are no test poses.",
    "A cause is an effect on one joint that the diagnosis of an arm's last dataset claims; joints that move the "
    "measured points by less than a quarter of what the largest of that effect does are left aside. It is told from "
    "three arms on. Its arms are held against each site, each further key of [about] and each range of serial numbers "
    "by Fisher's exact test, one-sided, against the rest of the arms of that model; the best of all ranges against "
    "the best where the cause is dealt out at random. All tests of the fleet are corrected together (Holm), and "
    "groups below p = 0.01 are told. A group that stands out is a place to look, not a proof: arms of one site often "
    "have one gear batch and neighbouring numbers too.",
    "Each dataset is held against the last calibration of the same serial number and of an earlier date, as inspector "
    "watch does: the earlier calibration predicts the later points. What a moved scanner, a moved base or "
    "more noise explains is not blamed on the arm.",
)


def fleet_html(fleet: Fleet, page: Path, *, now: datetime) -> str:
    """The page, to be written at `page`: links to the datasets lead from there. `now` is the date that it carries."""
    made = now.astimezone().strftime("%Y-%m-%d %H:%M %Z").strip()
    links = _Links(fleet.folder, page.resolve().parent)
    sections = (
        Section("Causes that arms share", _causes(fleet)),
        Section("Arms that changed", _drifts(fleet, links)),
        Section("The worst", _worst(fleet, links)),
        *([Section("Without a result", _failures(fleet, links))] if fleet.failures else []),
        Section("All datasets", _all(fleet, links)),
        Section("Method", (Bullets(METHOD),)),
        Section("Made with", (Facts(versions()), Paragraph(f"Made {made}.", soft=True))),
    )
    return render_page(f"Fleet: {fleet.folder.resolve().name}", _head(fleet, made), sections)


class _Links:
    """Addresses of datasets, from the page."""

    def __init__(self, folder: Path, page_folder: Path) -> None:
        self.folder, self.page_folder = folder, page_folder

    def of(self, path: str) -> Link:
        place = (self.folder / path).absolute()
        try:
            address = quote(Path(os.path.relpath(place, self.page_folder)).as_posix() + "/")
        except ValueError:  # on another drive
            address = place.as_uri()
        return Link(path, address)

    def command(self, path: str) -> str:
        return f"inspector serve {shlex.quote(str(self.folder / path))}"


def _head(fleet: Fleet, made: str) -> list[Block]:
    passed = sum(row.passed for row in fleet.rows)
    robots = sorted({row.robot for row in fleet.rows})
    figures: list[tuple[str, object]] = [
        ("Datasets", len(fleet.rows) + len(fleet.failures)),
        ("Arms", fleet.arms),
        ("Robots", numbers.listing(robots) if len(robots) < 4 else f"{len(robots)} models"),
        ("Pass the check", f"{passed} of {len(fleet.rows)}"),
        ("Without a result", len(fleet.failures)),
        ("Made", made),
    ]
    verdicts = [(verdict or "without a verdict", count) for verdict, count in fleet.verdicts.items()]
    return [
        KeyFigures(figures),
        Verdict(*_in_short(fleet)),
        Table(("verdict", "datasets"), verdicts, caption="How the diagnoses end"),
        *_errors(fleet),
    ]


def _in_short(fleet: Fleet) -> tuple[str, str]:
    """What needs somebody, and its colour."""
    said = []
    if batches := [cause for cause in fleet.shared if cause.groups]:
        said.append(numbers.count(len(batches), "cause") + f" with arms in common, most of all {batches[0].words}")
    if changed := {fleet.row(drift.later).arm for drift in fleet.drifted}:
        said.append(f"{numbers.count(len(changed), 'arm')} changed between two datasets")
    if odd := sum(row.verdict == "unexplained" for row in fleet.rows):
        said.append(f"{numbers.count(odd, 'dataset')} unexplained")
    if fleet.failures:
        said.append(f"{numbers.count(len(fleet.failures), 'dataset')} without a result")
    colour = BAD if fleet.failures else DOUBT
    return (f"{'; '.join(said)}.", colour) if said else ("Nothing stands out.", GOOD)


def _errors(fleet: Fleet) -> list[Block]:
    rows = sorted((row for row in fleet.rows if row.error_mm is not None), key=lambda row: (row.error_mm, row.path))
    if not rows:
        return []
    stages = [row.train if row.test.final_mm is None else row.test for row in rows]
    drawn = fleet_errors([row.path for row in rows], [(s.nominal_mm, s.links_mm, s.final_mm) for s in stages])
    return [Figure(drawn, "Errors of all datasets, the best at the left.")]


def _causes(fleet: Fleet) -> list[Block]:
    if not fleet.shared:
        return [Paragraph("No cause is claimed in three arms or more.")]
    out: list[Block] = []
    for cause in fleet.shared:
        if cause.groups:
            out.append(Verdict(f"{cause.words}.", DOUBT))
    rows = [
        (
            cause.where,
            cause.robot or "all models",
            f"{len(cause.arms)} of {cause.of}",
            length_text(cause.moves_mm),
            "; ".join(group.words for group in cause.groups) or "no group stands out",
        )
        for cause in fleet.shared
    ]
    headers = ("cause", "robot", "arms", "moves the tool by", "what these arms have in common")
    out.append(Table(headers, rows, left=(0, 1, 4), caption="Claimed by the diagnosis; median of the arms, RMS"))
    for cause in fleet.shared:
        if cause.groups:
            out.append(Paragraph(f"{cause.where}: arms {numbers.listing(list(cause.arms))}.", soft=True))
    return out


def _drifts(fleet: Fleet, links: _Links) -> list[Block]:
    if not fleet.drifts:
        return [Paragraph("No arm has two datasets with its serial number and different dates in [about].")]
    drifted = fleet.drifted
    out: list[Block] = []
    if drifted:
        out.append(_drift_table(fleet, drifted, links, "The arm itself changed"))
    else:
        out.append(Paragraph("None of the arms changed."))
    rest = [drift for drift in fleet.drifts if drift not in drifted]
    other = [drift for drift in rest if drift.verdict in ("changed", "unclear")]
    if other:
        caption = "The scanner, the base or the noise changed, or it cannot be told from the arm"
        out.append(_drift_table(fleet, other, links, caption))
    not_told = [drift for drift in rest if not drift.verdict]
    same = sum(drift.verdict == "unchanged" for drift in rest)
    out.append(Paragraph(f"{numbers.count(same, 'pair')} of datasets unchanged.", soft=True))
    if not_told:
        out.append(Bullets([f"{drift.base} and {drift.later} were not compared: {drift.words}" for drift in not_told]))
    return out


def _drift_table(fleet: Fleet, drifts: Sequence[Drift], links: _Links, caption: str) -> Table:
    rows = []
    for drift in drifts:
        base, later = fleet.row(drift.base), fleet.row(drift.later)
        off = "–" if drift.rmse_mm is None else length_text(drift.rmse_mm)
        rows.append((later.serial, later.robot, base.date, later.date, links.of(drift.later), off, drift.words))
    headers = ("arm", "robot", "from", "to", "dataset", "off by", "what changed")
    return Table(headers, rows, caption=caption, left=(0, 1, 2, 3, 4, 6))


def _worst(fleet: Fleet, links: _Links) -> list[Block]:
    rows = [
        (
            links.of(row.path), row.serial, row.robot, _mm(row.error_mm), _ratio(row), row.headline,
            links.command(row.path),
        )
        for row in fleet.worst()
    ]  # fmt: skip
    headers = ("dataset", "arm", "robot", "last error", "times noise", "verdict", "to look at it")
    return [Table(headers, rows, left=(0, 1, 2, 5, 6), caption="The largest errors that are left")]


def _failures(fleet: Fleet, links: _Links) -> list[Block]:
    rows = [(links.of(failure.path), failure.reason) for failure in fleet.failures]
    return [Table(("dataset", "why"), rows, left=(0, 1), caption="Each was tried twice")]


def _all(fleet: Fleet, links: _Links) -> list[Block]:
    rows = [
        (
            links.of(row.path), row.serial, row.site, row.date, row.robot, _mm(_delivered(row)), _mm(row.error_mm),
            row.verdict or "none", ", ".join(row.missing) or "–",
        )
        for row in fleet.rows
    ]  # fmt: skip
    headers = ("dataset", "arm", "site", "date", "robot", "delivered", "last error", "verdict", "missing")
    return [Table(headers, rows, left=(0, 1, 2, 3, 4, 7, 8))]


def _delivered(row: Row) -> float | None:
    return row.train.nominal_mm if row.test.final_mm is None else row.test.nominal_mm


def _mm(value: float | None) -> str:
    return "–" if value is None else length_text(value)


def _ratio(row: Row) -> str:
    return "–" if row.noise_ratio is None else f"{row.noise_ratio:.2g}"
