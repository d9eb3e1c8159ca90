"""Presentation of a campaign that is being measured: a line for each pose as it arrives, and the whole so far."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.calibration.noise_level import FIT, noise_level
from calib.dataset.files.poses_csv import in_unit_of, joint_columns
from calib.extras.follow.campaign import Campaign, PoseJudgement
from calib.planning.prediction import PAYS, STEP
from calib.present.results import document, keys_of, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Coloured, Paragraph, Presentation, Section, Table, Verdict, pose
from calib.rendering.colours import BAD, DOUBT, GOOD

_NAMES = 5  # that are told of many
_MISSES = 1.5  # residual over the noise, from which the model misses something
_COLOURS = {"good": GOOD, "doubtful": DOUBT, "repeat": BAD, "unknown": BAD}
_WHY = {
    "not seen": "the instrument saw no target; free the line of sight and measure it again",
    "not in poses.csv": "is of no pose that poses.csv has (yet)",
    "not compared": "found{own}; not compared yet: {why_no_fit}",
    "uncertain": "found, but its sigma of {sigma} is far above the others'; repeat it",
    "no target": "{failure}",
    "unreadable": "{failure}; export the scan again",
    "off": "{off}; measure it once more, and check its joint values",
    "": "found{own}, {off}",
}


@presentation.register
def _campaign(campaign: Campaign) -> Presentation:
    return Presentation(
        f"Campaign {campaign.dataset.name}",
        campaign_head(campaign),
        [Section("The poses, the latest first", [latest_first(campaign)], True)] if campaign.judged else [],
    )


def campaign_head(campaign: Campaign, tolerance_mm: float | None = None) -> list[Block]:
    """Blocks on the campaign so far: how many poses are good, the predicted error, what to measure next."""
    good, doubtful, again = (campaign.in_state(state) for state in ("good", "doubtful", "repeat"))
    told = f"{len(good)} of {numbers.count(len(good) + len(doubtful) + len(again), 'pose')} good"
    for what, names in (
        ("doubtful", doubtful), ("to repeat", again), ("of no pose that poses.csv has (yet)", campaign.unknown)
    ):  # fmt: skip
        told += f"; {what}: {numbers.listing(numbers.first_of(names, _NAMES))}" if names else ""
    return [
        Verdict(f"{told}.", GOOD if len(good) == len(campaign.judged) else DOUBT),
        *([Paragraph(moved_sentence(campaign.off_since))] if campaign.off_since else []),
        *map(Paragraph, outlook_sentences(campaign, tolerance_mm)),
    ]


def latest_first(campaign: Campaign) -> Table:
    """Table of the poses with their states, the latest first."""
    judged = reversed(list(campaign.judged.values()))
    rows = [(pose(j.pose), Coloured(j.state, _COLOURS[j.state]), _said(campaign, j)) for j in judged]
    return Table(("pose", "state", "found"), rows, left=(0, 1, 2))


def judgement_line(campaign: Campaign, judged: PoseJudgement) -> str:
    """Line on a pose as it arrived, or as it is judged anew: its state, why, and the error predicted by now."""
    now = "" if campaign.outlook is None else f"; predicted error {numbers.length(campaign.outlook.now.geometry_mm)}"
    return f"{judged.pose} {judged.state}: {_said(campaign, judged)}{now}"


def _said(campaign: Campaign, judged: PoseJudgement) -> str:
    """What is said of a pose, and what to do where it is not good."""
    sigma, error, promised = (
        numbers.length(each or 0.0) for each in (judged.sigma_mm, judged.error_mm, judged.promised_mm)
    )
    return _WHY[judged.reason].format(
        own="" if judged.sigma_mm is None else f", sigma {sigma}",
        sigma=sigma,
        why_no_fit=campaign.why_no_fit or "no fit",
        failure=judged.failure,
        off=f"{error} from what the fit predicts (standard deviation {promised})",
    )


def moved_sentence(since: str) -> str:
    """Sentence on an instrument or a target that may have been moved in the middle of a campaign, and what to do."""
    return (
        f"All poses since {since} are off: the instrument or the target may have been moved. Was it the instrument, "
        "give them another name in the column setup of poses.csv; a target has to be fastened, and they measured again."
    )


def outlook_sentences(campaign: Campaign, tolerance_mm: float | None = None) -> list[str]:
    """Sentences on the predicted error, on the poses to measure next, and on whether more pay."""
    outlook = campaign.outlook
    if outlook is None:
        return [f"No error is predicted yet: {campaign.why_no_fit}."] if campaign.why_no_fit else []
    now = outlook.now
    told = [
        f"Predicted error at {outlook.region}: {numbers.length(now.geometry_mm)} (90 % of arms: "
        f"{numbers.length(now.low_mm)} to {numbers.length(now.high_mm)}), without a point's noise."
    ]
    if tolerance_mm is not None and campaign.is_enough(tolerance_mm):
        told.append(f"That is within the {numbers.length(tolerance_mm)} asked for.")
    if not outlook.next:
        told.append("All planned poses are measured; inspector plan --add names more.")
    elif campaign.is_enough():
        told.append(f"More poses no longer pay: {STEP} more of the best lower it by less than {numbers.share(PAYS)}.")
    told += [f"Next: {'; '.join(outlook.next)}."] if outlook.next else []
    missed = _missed(campaign)
    return [*told, missed] if missed else told


def _missed(campaign: Campaign) -> str:
    """Sentence where the residual is far above the noise, so that more poses are not what is missing; else ""."""
    if campaign.calibration is None:
        return ""
    level = noise_level(campaign.calibration)
    sigma_mm = campaign.calibration.sigma_mm
    if level.source == FIT or not np.isfinite(sigma_mm) or sigma_mm < _MISSES * level.sigma_mm:
        return ""
    return (
        f"Calibrated links leave {numbers.length(sigma_mm)} per coordinate, {numbers.times(sigma_mm / level.sigma_mm)} "
        "the noise: something is missing in the model, which inspector diagnose looks for."
    )


# ---- documents ------------------------------------------------------------------------------------------------------


def judgement_document(campaign: Campaign, judged: PoseJudgement, tolerance_mm: float | None = None) -> dict[str, Any]:
    """Document of a pose as it arrived: one line of `inspector follow --json`."""
    return {
        **keys_of(judged, "pose", "state", "sigma_mm", "error_mm", "promised_mm"),
        "why": _said(campaign, judged),
        "reason": judged.reason or None,
        **_outlook_document(campaign, tolerance_mm),
    }


def _outlook_document(campaign: Campaign, tolerance_mm: float | None = None) -> dict[str, Any]:
    outlook, poses = campaign.outlook, campaign.dataset.poses
    return {
        "good": len(campaign.in_state("good")),
        "predicted_mm": None if outlook is None else outlook.now.geometry_mm,
        "predicted_90_mm": None if outlook is None else [outlook.now.low_mm, outlook.now.high_mm],
        "region": None if outlook is None else outlook.region,
        "next": [] if outlook is None else [_next(campaign, poses.index(pose_id)) for pose_id in outlook.next],
        "enough": campaign.is_enough(tolerance_mm),
        **keys_of(campaign, "off_since", "unknown"),
    }


def _next(campaign: Campaign, row: int) -> dict[str, Any]:
    poses, columns = campaign.dataset.poses, joint_columns(campaign.dataset.robot)
    joints = {name: in_unit_of(name, float(q)) for name, q in zip(columns, poses.q[row], strict=True)}
    return {"pose": poses.ids[row], "setup": str(poses.setup[row]), **joints}


@document.register
def _document(campaign: Campaign) -> dict[str, Any]:
    judged = [judgement_document(campaign, each) for each in campaign.judged.values()]
    return {"poses": judged, **_outlook_document(campaign)}
