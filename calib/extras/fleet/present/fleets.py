"""Presentation of a fleet: shared causes, arms that changed, worst datasets, failures, and a row per dataset."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from calib.extras.fleet.drift import Drift, change_test
from calib.extras.fleet.result import Fleet
from calib.extras.fleet.row import Row
from calib.extras.fleet.shared_causes import Group, SharedCause
from calib.plugins import load
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
    "each further key of [about] with the rest of the arms of that model by Fisher's exact test, one-sided; the range "
    "of serial numbers and the range of dates in which the cause is most frequent with those where it is dealt out at "
    "random (permutations, Kolmogorov and Smirnov). All tests of the fleet are corrected together (Holm), and groups "
    "below p = 0.05 are listed. A group that stands out is a place to look, not a proof: arms of one site often have "
    "one gear batch and neighbouring numbers too.",
    "Each dataset is compared with the last calibration of the same serial number and of an earlier date, as inspector "
    "watch does: the earlier calibration predicts the later points. What a moved scanner, a moved base or more noise "
    "explains is not blamed on the arm.",
)
_ARMS, _ROBOTS = 20, 3  # that are named of a cause, and at the head
Naming = Callable[[str], Span]  # a dataset's path -> what stands for it, such as a link


@presentation.register
def fleet_presentation(fleet: Fleet, name: Naming = str, *more: Section) -> Presentation:
    """Presentation of a fleet, in which `name` stands for a path, with further sections."""
    sections = [
        Section("Causes that arms share", _causes(fleet), brief=True),
        Section("Arms that changed", _drifts(fleet, name), brief=True),
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
    if fleet.drifted:
        found.append(f"{numbers.count(len(fleet.drifted), 'change')} of an arm between two datasets")
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


# ---- arms that changed ----------------------------------------------------------------------------------------------


def drift_phrases(drift: Drift) -> str:
    """Phrases on what changed between two datasets of an arm, or on why that is unknown."""
    test = change_test()
    phrases = [] if test is None else map(load(test.phrase), drift.changes)
    return drift.reason or "; ".join(phrases) or drift.verdict


def _drifts(fleet: Fleet, name: Naming) -> list[Block]:
    if not fleet.drifts and change_test() is None:
        return [Paragraph("Datasets of one arm are not compared: what tests for changes (watch) is not installed.")]
    if not fleet.drifts:
        return [Paragraph("No arm has two datasets with its serial number and different dates in [about].")]
    rows, of_path = [], {row.path: row for row in fleet.rows}
    for drift in sorted(fleet.drifts, key=lambda drift: not drift.of_the_arm):
        if drift.verdict != "unchanged":
            base, later = of_path[drift.base], of_path[drift.later]
            blamed = "yes" if drift.of_the_arm else "no, or unclear"
            off = numbers.column_mm(drift.rmse_mm)
            rows.append((later.serial, base.date, later.date, name(drift.later), off, blamed, drift_phrases(drift)))
    headers = ("arm", "from", "to", "dataset", "off by, mm", "the arm itself", "what changed")
    same = sum(drift.verdict == "unchanged" for drift in fleet.drifts)
    return [
        *([] if fleet.drifted else [Paragraph("None of the arms changed.")]),
        *([Table(headers, rows, left=(0, 1, 2, 3, 5, 6))] if rows else []),
        Paragraph(f"{numbers.count(same, 'pair')} of datasets unchanged.", soft=True),
    ]


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
        "drift": [_drift_document(drift) for drift in fleet.drifts],
        "shared_causes": fleet.shared,
        "worst": [row.path for row in fleet.worst()],
    }


def _drift_document(drift: Drift) -> dict[str, Any]:
    told = keys_of(drift, "base", "later", "verdict", "changes", "rmse_mm", "of_the_arm")
    return told | {"words": drift_phrases(drift)}
