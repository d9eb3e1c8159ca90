"""Recommended actions for an arm's owner: table, compensation, confirmation, poses to measure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.calibration.noise_level import FIT
from calib.calibration.result import Calibration
from calib.compensation.correction import Correction
from calib.diagnosis.headline import Headline
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import descriptions
from calib.effects.catalogue.order_steps import ScannerStep
from calib.models.exported_table import ExportedTable
from calib.planning.discrimination import NextPoses
from calib.present.diagnosis.diagnosis import poses_to_measure
from calib.present.effects import title
from calib.present.fit import errors as headlines
from calib.present.results import headline
from calib.rendering import numbers
from calib.screening.curves.smooth_joint_error import LEARNED

_AGAIN = 3  # poses to measure once more
_ADVISED = 0.95  # of the measured poses have to be reached, or correcting targets is no advice


def what_to_do(
    headline: Headline,
    table: ExportedTable,
    correction: Correction | None,
    diagnosis: Diagnosis | None,
    next_poses: NextPoses | None,
    outlier_poses: Sequence[str],
) -> list[str]:
    """List of recommended actions in plain words, the most useful first.

    Args:
        headline: the errors of the arm, stage by stage.
        table: of the model.
        correction: of the measured poses, where the model has effects, which no table can hold.
        diagnosis: None for a model that was put together by hand.
        next_poses: that discriminate between the effects that a diagnosis leaves open.
        outlier_poses: poses that stand out of all others.
    """
    model = table.full.model
    compensates = [_compensation(table.full, correction, headline)] if model.arm_family_names else []
    to_measure = _to_measure(table.full, diagnosis, next_poses, outlier_poses)
    of_measuring = [name for name in model.family_names if name not in model.arm_family_names]
    return [
        _table_to_load(table, headline),
        *compensates,
        *_of_measuring(of_measuring, diagnosis),
        *_confirmations(diagnosis),
        *to_measure,
    ]


def _of_measuring(names: Sequence[str], diagnosis: Diagnosis | None) -> list[str]:
    """Sentences on effects of the instrument and the target: nothing is mended on the arm because of them."""
    moves = () if diagnosis is None else diagnosis.instrument_moved
    actions = [
        f"The instrument was moved between {move.after} and {move.before}: look at its stand, and declare a new setup "
        f"from {move.before} on (--new-setup {move.before}, or the page's button beside the verdict). Nothing is to be "
        "mended on the arm because of it."
        for move in moves
    ]
    if others := [name for name in names if not (moves and name == ScannerStep.name)]:
        told = numbers.listing([title(name) for name in others])
        are = "are" if len(others) > 1 else "is"
        actions.append(
            f"Mend nothing on the arm because of {told}: what {are} of the instrument or the target stays out of the "
            "table and of corrected targets."
        )
    return actions


def _table_to_load(table: ExportedTable, headline: Headline) -> str:
    if table.full.model.robot.is_cartesian:
        return "Take the places and their sigmas that inspector calibrate tells: poses of the flange tell no links."
    figures = table.errors.test if headline.of_test_poses else table.errors.train
    before = headline.stages[0].error_mm
    if figures is None or not figures.rmse_mm < before:
        return "Load no new table: by itself it would not make the arm better than it was delivered."
    return (
        "Load the calibrated table into the controller (robot.toml of inspector calibrate --out, or of the page's tab "
        f"Take away). By itself it takes the error from {headlines.length(headline, before)} to "
        f"{headlines.length(headline, figures.rmse_mm)}."
    )


def _compensation(calibration: Calibration, correction: Correction | None, headline: Headline) -> str:
    families = calibration.model.arm_family_names
    names = numbers.listing(["the learned curves" if name == LEARNED else title(name) for name in families])
    if correction is not None and correction.reached.mean() < _ADVISED:
        reached, count = int(correction.reached.sum()), len(correction.reached)
        return (
            f"No table can hold {names}, and corrected joint targets would not bring the arm there: only {reached} of "
            f"the {count} measured poses are reached by motions that a correction can be. Mend the cause on the arm, "
            "and calibrate again."
        )
    return (
        f"Compensate {names}, which no table can hold: correct the joint targets of your programs (inspector correct), "
        f"and the error goes down to {headlines.length(headline, headline.stages[-1].error_mm)}. Or mend the cause on "
        "the arm, and calibrate again."
    )


def _confirmations(diagnosis: Diagnosis | None) -> list[str]:
    """Sentences on the measurements that confirm each cause alone, before a gear is opened."""
    if diagnosis is None:
        return []
    confirm = {described.name: described.confirm for described in descriptions()}
    names = dict.fromkeys((*diagnosis.missing, *diagnosis.suspected, *diagnosis.ambiguous_set))
    return [f"To be sure of {title(name)}, measure: {confirm[name]}." for name in names if confirm.get(name)]


def _to_measure(
    calibration: Calibration, diagnosis: Diagnosis | None, next_poses: NextPoses | None, outlier_poses: Sequence[str]
) -> list[str]:
    actions = []
    dataset, after = calibration.dataset, calibration.after
    if next_poses and next_poses.change:
        actions.append(headline(next_poses.change))
    if next_poses and next_poses.discrimination and next_poses.poses:
        poses = poses_to_measure(next_poses.poses[:_AGAIN], dataset.robot.is_revolute)
        open_causes = numbers.listing([title(key) for key in next_poses.discrimination.hypotheses], "from")
        actions.append(
            f"To tell {open_causes} apart, measure at these joints, in degrees: "
            f"{poses} (inspector plan --for split plans them)."
        )
    exchanged = () if diagnosis is None else diagnosis.swapped
    swapped = {name for pair in exchanged for name in pair}
    if exchanged:
        pairs = [f"{one} and {other}" for one, other in exchanged]
        actions.append(f"Exchange the measurements of {numbers.listing(pairs)}: each lies where the other has to be.")
    if again := [name for name in outlier_poses if name not in swapped]:
        actions.append(f"Measure {numbers.listing(again)} again: they stand out from all others.")
    if after.test is None:
        actions.append(
            "Measure some poses more and give them the role test in poses.csv: nothing confirms these figures yet."
        )
    number = diagnosis and diagnosis.residual_tests.strongest_joint
    if number and diagnosis and diagnosis.verdict == "unexplained" and diagnosis.data_problem is None:
        actions.append(f"Look at joint {number}: what has no known cause shows most in its motion.")
    if not actions:
        order = np.argsort(-np.linalg.norm(after.error_mm, axis=1))
        worst = list(dict.fromkeys(dataset.poses.ids[i] for i in after.pose[order]))[:_AGAIN]
        actions.append(f"To check the arm later, measure {numbers.listing(worst)} again: they are off the most today.")
    return actions


# ---- the verdict for an owner --------------------------------------------------------------------------------------


def plain_verdict(headline: Headline, diagnosis: Diagnosis | None) -> str:
    """Sentences with the verdict for an owner who knows no kinematics: errors, causes, and how far to trust these."""
    if diagnosis is not None and diagnosis.data_problem is not None:
        return (
            f"These measurements do not fit this arm's table: {diagnosis.data_problem.warning}. Correct that first; "
            "the figures below say nothing about the arm."
        )
    first_mm, last_mm = headline.stages[0].error_mm, headline.stages[-1].error_mm
    first, last = headlines.length(headline, first_mm), headlines.length(headline, last_mm)
    at = "at poses that only served to test it" if headline.of_test_poses else "at the measured poses"
    then = f"with all that was found put right, by {last}."
    if headline.fits_links and last_mm > first_mm:
        then = f"after calibration it would be off by {last}, which is worse: do not use it."
    became = f"As delivered, the arm is off by {first} (RMS, {at}); {then}"
    return " ".join(filter(None, (became, *_causes_in_short(headline, diagnosis))))


def _rest(headline: Headline) -> str:
    if headline.reached_noise:
        return "What is left is the scatter of the measurement."
    if headline.noise_ratio is None or headline.noise.source == FIT:
        return ""
    return f"What is left is {numbers.times(headline.noise_ratio)} the scatter of the measurement."


def _causes_in_short(headline: Headline, diagnosis: Diagnosis | None) -> list[str]:
    if diagnosis is None:
        return []
    stages = headline.stages
    links = ["links that differ a little from the drawing"] if stages[1].error_mm < stages[0].error_mm else []
    of_arm = diagnosis.calibration.model.arm_family_names
    causes = [*links, *(title(key) for key in diagnosis.missing if key in of_arm)]
    falsified = [title(key) for key in diagnosis.missing if key not in of_arm]
    why = f"What makes its error: {numbers.listing(causes)}." if causes else ""
    if falsified:
        why += f" What falsified the measurements, and is no error of the arm: {numbers.listing(falsified)}."
    match diagnosis.verdict:
        case "adequate" | "named":
            return [why, _rest(headline)]
        case "ambiguous":
            open_causes = numbers.listing([title(key) for key in diagnosis.ambiguous_set], "or")
            return [why, f"One more cause is among these, and the measurements cannot tell which: {open_causes}."]
        case "outliers":
            poses = numbers.listing(diagnosis.outlier_poses)
            return [why, f"Single measurements stand out, {poses}: measure them again."]
    suspected = numbers.listing([title(key) for key in diagnosis.suspected])
    doubt = f"{numbers.capitalised(suspected)} may play a part; that is not proven." if suspected else ""
    return [why, "A part of the error has no known cause.", doubt, "Take nothing apart because of it yet."]
