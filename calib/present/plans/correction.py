"""Presentation of corrected joint targets: number reached, gain by the correction, and reasons for missed targets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calib.compensation.correction import Correction
from calib.compensation.target_files import Targets, corrected_table, load_targets, require_conditions
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.models.fitted_model import FittedModel
from calib.present.results import document, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Facts, Paragraph, Presentation, Table
from calib.statistics import rms

_MOST_TARGETS = 20_000  # that a page corrects
_LISTED = 20  # targets that are not reached, with the reason each


@presentation.register
def _correction(correction: Correction) -> Presentation:
    return Presentation("Corrected joint targets", correction_blocks(correction))


def correction_blocks(correction: Correction, ids: Sequence[str] = ()) -> list[Block]:
    """Blocks on a correction, with the targets' names where they have any."""
    if not len(correction.q):
        return [Paragraph("No target.")]
    missed = np.flatnonzero(~correction.reached)
    rows = [(ids[i] if ids else f"target {i + 1}", correction.reasons[i]) for i in missed[:_LISTED]]
    more = len(missed) - len(rows)
    reached = ("targets reached", f"{int(correction.reached.sum())} of {len(correction.q)} ({correction.kind})")
    return [
        *gain_blocks(correction, [reached]),
        Table(("not reached", "why"), rows, left=(0, 1)),
        Paragraph(f"and {more} more" if more > 0 else ""),
    ]


def read_table(path: Path, robot: Robot) -> Targets:
    """Joint targets of a table that a page brought; see `load_targets`. Raises CalibError for more than it corrects."""
    targets = load_targets(path, robot)
    if len(targets.poses) > _MOST_TARGETS:
        raise CalibError(f"{path}: {len(targets.poses):,} targets; a page corrects {_MOST_TARGETS:,}, the command all")
    return targets


def correct_table(targets: Targets, robot: Robot, model: FittedModel) -> tuple[bytes, list[Block]]:
    """The table of targets corrected by a model, as CSV, with what is told of it. Raises CalibError."""
    require_conditions(targets, model.needs, model.model.family_names)
    correction = model.correct(targets.poses.q, targets.poses, None, robot, targets.poses.ids)
    return corrected_table(targets, correction).encode(), correction_blocks(correction, targets.poses.ids)


def gain_blocks(correction: Correction, first: Sequence[tuple[str, object]] = ()) -> list[Block]:
    """Facts on the errors without correction, the moves and the promise, after `first`, and the remarks on them."""
    remarks = (Paragraph(f"{numbers.capitalised(words)}.") for words in _remarks(correction) if words)
    return [Facts([*first, *_facts(correction)]), *remarks]


def _facts(correction: Correction) -> list[tuple[str, object]]:
    turning, moved = correction.robot.is_revolute, np.abs(correction.change[correction.reached])
    largest = [
        *([numbers.size(float(moved[:, turning].max(initial=0.0)), "rad")] if turning.any() else []),
        *([numbers.length(float(moved[:, ~turning].max(initial=0.0)))] if not turning.all() else []),
    ]
    mean, worst = numbers.length(correction.uncorrected_mm.mean()), numbers.length(correction.uncorrected_mm.max())
    return [
        ("error without correction", f"{mean} on average, {worst} at most"),
        ("largest change of a joint", numbers.listing(largest)),
        *([("promised error", promised)] if (promised := promised_words(correction)) else []),
    ]


def promised_words(correction: Correction) -> str:
    """3D error that is promised for the corrected targets, within and outside the trained ranges; "" if unknown."""
    sigma_mm = correction.sigma_mm
    if sigma_mm is None:
        return ""
    beyond = np.zeros(len(sigma_mm), dtype=bool) if correction.is_outside is None else correction.is_outside
    parts = [(sigma_mm[~beyond], ""), (sigma_mm[beyond], " outside the trained ranges")]
    said = [f"{numbers.length(float(np.sqrt(3.0 * np.mean(of**2))))}{where}" for of, where in parts if len(of)]
    return f"{', '.join(said)} (3D, RMS, as measured)"


def _remarks(correction: Correction) -> list[str]:
    as_after = f"the arm is taken as it is after the last measured pose ({', '.join(correction.changed)})"
    return [attitude_phrase(correction), correction.outside_words, as_after if correction.changed else ""]


def attitude_phrase(correction: Correction) -> str:
    """Phrase on the uncertainty of the tool's attitude and whether it is corrected; "" where it is not known."""
    sigma_rad = correction.attitude_sigma_rad
    if sigma_rad is None or not len(correction.q):
        return ""
    known, turn = (numbers.digits(1e3 * rms(a)) for a in (sigma_rad, correction.uncorrected_rad))
    phrase = f"the fit knows the tool's attitude to {known} mrad (sigma), a correction turns it by {turn} mrad"
    return phrase if correction.kind == "pose" else f"{phrase}: the positions are corrected and no attitude is claimed"


@document.register
def _correction_document(correction: Correction) -> dict[str, Any]:
    return correction_document(correction, [f"target {i + 1}" for i in range(len(correction.q))])


def correction_document(correction: Correction, ids: Sequence[str]) -> dict[str, Any]:
    """Document that `correct --json` prints: each target with its errors; unreachable ones with the reason."""
    commanded = correction.robot.commands_of(correction.q)
    targets = [
        {"pose": pose, **row, "q": q if row["reached"] else None}
        for pose, row, q in zip(ids, correction.to_frame().to_dict(orient="records"), commanded, strict=True)
    ]
    outside = correction.is_outside
    return {
        "what": correction.kind,
        "reached": int(correction.reached.sum()),
        "not_reached": [{"pose": pose, "why": why} for pose, why in zip(ids, correction.reasons, strict=True) if why],
        "largest_move_deg": correction.largest_move_deg,
        "outside": None if outside is None else [pose for pose, is_out in zip(ids, outside, strict=True) if is_out],
        "notes": list(filter(None, _remarks(correction))),
        "targets": targets,
    }
