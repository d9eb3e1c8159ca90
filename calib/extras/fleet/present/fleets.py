"""Presentation of a fleet: shared causes, worst datasets, failures, and a row per dataset."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from calib.extras.fleet.result import Fleet
from calib.extras.fleet.row import Row
from calib.extras.fleet.shared_causes import Group, SharedCause
from calib.present.results import document, keys_of, presentation
from calib.rendering import numbers
from calib.rendering.blocks import (
    Block,
    KeyFigures,
    Paragraph,
    Presentation,
    Section,
    Span,
    Table,
    Verdict,
)
from calib.rendering.colours import BAD, DOUBT, GOOD

METHOD = (
    "Each dataset is judged by itself as inspector check does: corners, fit, diagnosis. An error is the 3D RMSE of the "
    "test poses, which no fit saw, or of the fitted poses where there are no test poses.",
    "A cause is an effect on one joint that an arm's diagnosis claims, or finds likely with a probability of a half or "
    "more, on average of the arm's datasets; joints that move the measured points by less than a quarter of what the "
    "largest of that effect does are left aside. It is listed from three arms on. Its arms are compared for each site, "
    "each further key of [about] with the rest of the arms of that model by Fisher's exact test, one-sided. All tests "
    "of the fleet are corrected together (Holm), and groups below p = 0.05 are listed. A group that stands out is a "
    "place to look, not a proof: arms of one site often have one gear batch too.",
)
_ARMS, _ROBOTS = 20, 3  # that are named of a cause, and at the head
Naming = Callable[[str], Span]  # a dataset's path -> what stands for it, such as a link


@presentation.register
def fleet_presentation(fleet: Fleet, name: Naming = str, *more: Section) -> Presentation:
    """Presentation of a fleet, in which `name` stands for a path, with further sections."""
    sections = [
        Section("Causes that arms share", _causes(fleet), brief=True),
        Section("The worst", [_datasets(fleet.worst(), name)], brief=True),
        *([Section("Without a result", [_failures(fleet, name)], brief=True)] if fleet.failures else []),
        Section("All datasets", [_datasets(fleet.rows, name)]),
    ]
    return Presentation(f"Fleet: {fleet.folder.resolve().name}", _head(fleet), [*sections, *more])


def _head(fleet: Fleet) -> list[Block]:
    """Blocks at the head of a fleet: counts, items that need attention, verdicts and errors."""
    passed = sum(row.passed for row in fleet.rows)
    robots = sorted({row.robot for row in fleet.rows})
    figures: list[tuple[str, object]] = [
        ("Datasets", len(fleet.rows) + len(fleet.failures)),
        ("Arms", len({row.arm for row in fleet.rows})),
        ("Robots", numbers.in_short(robots, _ROBOTS)),
        ("Pass the check", f"{passed} of {len(fleet.rows)}"),
        ("Without a result", len(fleet.failures)),
        ("Taken from an earlier run", fleet.taken_over),
    ]
    verdicts = Counter(row.verdict or "without a verdict" for row in fleet.rows).most_common()
    return [
        KeyFigures(figures),
        _in_short(fleet),
        Table(("verdict", "datasets"), verdicts, caption="How the diagnoses end"),
    ]


def _in_short(fleet: Fleet) -> Verdict:
    """Verdict with the items of a fleet that need attention."""
    found = []
    if batches := [cause for cause in fleet.shared if cause.groups]:
        found.append(
            f"{numbers.count(len(batches), 'cause')} with arms in common, most of all {cause_phrase(batches[0])}"
        )
    if odd := sum(row.verdict == "unexplained" for row in fleet.rows):
        found.append(f"{numbers.count(odd, 'dataset')} unexplained")
    if fleet.failures:
        found.append(f"{numbers.count(len(fleet.failures), 'dataset')} without a result")
    if not found:
        return Verdict("Nothing stands out.", GOOD)
    return Verdict(f"{'; '.join(found)}.", BAD if fleet.failures else DOUBT)


# ---- causes that arms share -----------------------------------------------------------------------------------------


def cause_name(cause: SharedCause) -> str:
    """Name of a shared cause: "joint_compliance of joint 2"."""
    return cause.effect if cause.joint is None else f"{cause.effect} of joint {cause.joint}"


def group_phrase(group: Group) -> str:
    """Phrase on what arms with a cause have in common: "8 of 10 with gear lot 17, 1 of 50 others (p = 1e-07)"."""
    (a, n), (b, m) = group.inside, group.outside
    return f"{a} of {n} with {group.what} {group.value}, {b} of {m} others (p = {numbers.probability(group.p_value)})"


def cause_phrase(cause: SharedCause) -> str:
    """Phrase on a shared cause: the number of arms that have it, and the properties common to these arms."""
    common = "; ".join(map(group_phrase, cause.groups)) or "no group of them stands out"
    return f"{cause_name(cause)} in {len(cause.arms)} of {cause.of} arms {cause.robot}: {common}"


def _causes(fleet: Fleet) -> list[Block]:
    if not fleet.shared:
        return [Paragraph("No cause is claimed or likely in three arms or more.")]
    rows = [
        (
            cause_name(cause),
            cause.robot,
            f"{len(cause.arms)} of {cause.of}",
            numbers.column_mm(cause.moves_mm),
            "; ".join(map(group_phrase, cause.groups)) or "no group stands out",
            numbers.in_short(cause.arms, _ARMS) if cause.groups else numbers.MISSING,
        )
        for cause in fleet.shared
    ]
    headers = ("cause", "robot", "arms", "moves the tool by, mm", "what these arms have in common", "which")
    caption = "Claimed by the diagnosis, or likely; median of the arms, RMS"
    return [Table(headers, rows, left=(0, 1, 4, 5), caption=caption)]


# ---- datasets -------------------------------------------------------------------------------------------------------


def _failures(fleet: Fleet, name: Naming) -> Table:
    rows = [(name(failure.path), failure.reason) for failure in fleet.failures]
    return Table(("dataset", "why"), rows, left=(0, 1), caption="Each was tried twice")


def _datasets(rows: Sequence[Row], name: Naming) -> Table:
    cells = [
        (
            name(row.path), row.serial, row.site, row.date, row.robot, numbers.column_mm(row.delivered_mm),
            numbers.column_mm(row.error_mm), numbers.MISSING if row.noise_ratio is None else f"{row.noise_ratio:.2g}",
            row.verdict or row.words, ", ".join(row.missing) or numbers.MISSING,
        )
        for row in rows
    ]  # fmt: skip
    errors = ("delivered, mm", "last error, mm", "times noise")
    headers = ("dataset", "arm", "site", "date", "robot", *errors, "verdict", "missing")
    return Table(headers, cells, left=(0, 1, 2, 3, 4, 8, 9))


# ---- the document ---------------------------------------------------------------------------------------------------


@document.register
def _fleet_document(fleet: Fleet) -> dict[str, Any]:
    return keys_of(fleet, "taken_over", "seconds", "rows") | {
        "folder": str(fleet.folder),
        "datasets": len(fleet.rows) + len(fleet.failures),
        "failed": fleet.failures,
        "shared_causes": fleet.shared,
        "worst": [row.path for row in fleet.worst()],
    }
