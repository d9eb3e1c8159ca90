"""Presentation of a campaign that is being measured: a line for each pose as it arrives, and the whole so far."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from calib.calibration.noise_level import FIT, noise_level
from calib.dataset.files.poses_csv import in_unit_of, joint_columns
from calib.extras.follow.campaign import Campaign
from calib.extras.follow.judgement import PoseJudgement
from calib.extras.follow.outlook import NextPose
from calib.kinematics.robot import Robot
from calib.planning.prediction import PAYS, STEP
from calib.present.results import document, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Coloured, Paragraph, Presentation, Section, Table, Verdict, pose
from calib.rendering.colours import BAD, DOUBT, GOOD

_MISSES = 1.5  # residual over the noise, from which the model misses something
_COLOURS = {"good": GOOD, "doubtful": DOUBT, "repeat": BAD}


@presentation.register
def _campaign(campaign: Campaign) -> Presentation:
    return Presentation(
        f"Campaign {campaign.dataset.name}",
        campaign_head(campaign),
        [Section("The poses, the latest first", [latest_first(campaign)], True)] if campaign.judged else [],
    )


def campaign_head(campaign: Campaign, tolerance_mm: float | None = None) -> list[Block]:
    """Blocks on the campaign so far: how many poses are good, the predicted error, what to measure next."""
    judged = list(campaign.judged.values())
    doubtful = [j.pose for j in judged if j.state == "doubtful"]
    again = [j.pose for j in judged if j.state == "repeat"]
    told = f"{len(campaign.good)} of {numbers.count(len(judged), 'pose')} good"
    told += f", doubtful: {numbers.listing(doubtful)}" if doubtful else ""
    told += f", to repeat: {numbers.listing(again)}" if again else ""
    blocks: list[Block] = [Verdict(f"{told}.", GOOD if not doubtful and not again else DOUBT)]
    blocks += [Paragraph(moved_sentence(campaign.off_since))] if campaign.off_since else []
    blocks += [Paragraph(f"{unknown_sentence(campaign.unknown)}.")] if campaign.unknown else []
    sentences = outlook_sentences(campaign, tolerance_mm)
    return [*blocks, *[Paragraph(sentence) for sentence in sentences]]


_NAMES = 5  # that are told of many


def unknown_sentence(unknown: Sequence[str]) -> str:
    """Sentence, without its full stop, on what was measured of poses that poses.csv does not have."""
    are = "is" if len(unknown) == 1 else "are"
    return f"{numbers.listing(numbers.first_of(unknown, _NAMES))} {are} of no pose that poses.csv has (yet)"


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
    own = "" if judged.sigma_mm is None else f", sigma {numbers.length(judged.sigma_mm)}"
    match judged.reason:
        case "not seen":
            return "the instrument saw no target; free the line of sight and measure it again"
        case "unreadable":
            return f"{judged.failure}; export the scan again"
        case "no target":
            return judged.failure
        case "not compared":
            return f"found{own}; not compared yet: {campaign.why_no_fit or 'no fit'}"
        case "uncertain":
            return (
                f"found, but its sigma of {numbers.length(judged.sigma_mm or 0.0)} is far above the others'; repeat it"
            )
        case "off":
            return f"{_off(judged)}; measure it once more, and check its joint values"
        case _:
            return f"found{own}, {_off(judged)}" if judged.error_mm is not None else f"found{own}"


def _off(judged: PoseJudgement) -> str:
    assert judged.error_mm is not None
    assert judged.promised_mm is not None
    error, promised = numbers.length(judged.error_mm), numbers.length(judged.promised_mm)
    return f"{error} from what the fit predicts (standard deviation {promised})"


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
    if campaign.is_within(tolerance_mm):
        assert tolerance_mm is not None
        told.append(f"That is within the {numbers.length(tolerance_mm)} asked for.")
    if campaign.has_enough:
        told.append(f"More poses no longer pay: {STEP} more of the best lower it by less than {numbers.share(PAYS)}.")
    if outlook.next:
        told.append(f"Next: {'; '.join(_next(campaign, n) for n in outlook.next)}.")
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
        f"The link errors leave {numbers.length(sigma_mm)} per coordinate, {numbers.times(sigma_mm / level.sigma_mm)} "
        "the noise: something is missing in the model, which inspector diagnose looks for."
    )


def _next(campaign: Campaign, wanted: NextPose) -> str:
    if wanted.pose is not None:
        return wanted.pose
    return "joints " + " ".join(f"{value:.1f}" for value in _joints(campaign.dataset.robot, wanted))


def _joints(robot: Robot, wanted: NextPose) -> list[float]:
    return [in_unit_of(name, float(value)) for name, value in zip(joint_columns(robot), wanted.q, strict=True)]


# ---- documents ------------------------------------------------------------------------------------------------------


def judgement_document(campaign: Campaign, judged: PoseJudgement, tolerance_mm: float | None = None) -> dict[str, Any]:
    """Document of a pose as it arrived: one line of `inspector follow --json`."""
    return {
        "pose": judged.pose,
        "state": judged.state,
        "why": _said(campaign, judged),
        "reason": judged.reason or None,
        "sigma_mm": judged.sigma_mm,
        "error_mm": judged.error_mm,
        "promised_mm": judged.promised_mm,
        **_outlook_document(campaign, tolerance_mm),
    }


def unknown_document(campaign: Campaign, name: str, tolerance_mm: float | None = None) -> dict[str, Any]:
    """Document of a name that poses.csv does not have: one line of `inspector follow --json`."""
    why = {"pose": name, "state": "unknown", "why": unknown_sentence([name]), "reason": "not in poses.csv"}
    return {**why, **_outlook_document(campaign, tolerance_mm)}


def _outlook_document(campaign: Campaign, tolerance_mm: float | None) -> dict[str, Any]:
    outlook, columns = campaign.outlook, joint_columns(campaign.dataset.robot)
    return {
        "good": len(campaign.good),
        "predicted_mm": None if outlook is None else outlook.now.geometry_mm,
        "predicted_90_mm": None if outlook is None else [outlook.now.low_mm, outlook.now.high_mm],
        "region": None if outlook is None else outlook.region,
        "next": []
        if outlook is None
        else [
            {"pose": n.pose, "setup": n.setup, **dict(zip(columns, _joints(campaign.dataset.robot, n), strict=True))}
            for n in outlook.next
        ],
        "enough": campaign.has_enough or campaign.is_within(tolerance_mm),
        "off_since": campaign.off_since,
        "unknown": campaign.unknown,
    }


@document.register
def _document(campaign: Campaign) -> dict[str, Any]:
    return {
        "poses": [judgement_document(campaign, j) for j in campaign.judged.values()],
        **_outlook_document(campaign, None),
    }
