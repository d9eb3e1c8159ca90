"""The first page of a report, for the arm's owner: its present accuracy, the causes found, what to do."""

from __future__ import annotations

import numpy as np

from calib.calibration.evaluation import Figures
from calib.calibration.model_versions import versions
from calib.dataset.dataset import Dataset
from calib.diagnosis.headline import Headline as HeadlineFacts
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import descriptions
from calib.present import error_headline as headlines
from calib.present import numbers
from calib.present.blocks import (
    Block,
    Bullets,
    Drawing,
    KeyFigures,
    Paragraph,
    Table,
    Verdict,
)
from calib.present.diagnosis import poses_to_measure, verdict_block
from calib.screening.curves.smooth_joint_error import LEARNED
from inspector.markup.parts.palette import NEUTRAL
from inspector.report.arm_drawing import arm_drawing, stride
from inspector.report.content import Report, model_name

_AGAIN = 3  # poses to measure once more
_ADVISED = 0.95  # of the measured poses have to be reached, or correcting targets is no advice
_FIGURES = (("mean", "mean_mm"), ("RMS", "rmse_mm"), ("maximum", "max_mm"))


def first_page(report: Report, made: str) -> tuple[Block, ...]:
    """Blocks of the first page, in the order of reading; `made` is the date of the report."""
    told = report.session.headline
    assert told is not None
    return (
        KeyFigures(_about(report.dataset, made)),
        headlines.error_headline(told),
        _verdict(report),
        _picture(report, told),
        errors_table(report, told),
        Paragraph("What to do", heading=True),
        Bullets(what_to_do(report)),
    )


def _about(dataset: Dataset, made: str) -> list[tuple[str, object]]:
    about, robot = dataset.about, dataset.robot
    told = (
        ("Arm", f"{robot.name}, {robot.n_joints} joints"),
        ("Serial number", about.serial),
        ("Site", about.site),
        ("Operator", about.operator),
        ("Measured", about.date),
        ("Report made", made),
    )
    return [(name, value) for name, value in told if value]


def _verdict(report: Report) -> Verdict:
    found = report.diagnosis
    if found is None:
        return Verdict(f"No verdict: the model ({model_name(report.calibration)}) was put together by hand.", NEUTRAL)
    return verdict_block(found)


def _picture(report: Report, told: HeadlineFacts) -> Drawing:
    shown = versions(report.calibration, report.session.links_alone)
    reference = report.dataset.poses.reference
    first, last = told.stages[0], told.stages[-1]
    words = (
        f"{first.name}: {headlines.length(told, first.error_mm)}",
        f"{_name_now(report)}: {headlines.length(told, last.error_mm)}",
    )
    pose = report.dataset.poses.ids[reference]
    count, every = len(shown[0].evaluation.pose), stride(len(shown[0].evaluation.pose))
    where = f"all {count}" if every == 1 else f"{-(-count // every)} of {count}"
    caption = f"The arm at pose {pose}, and the errors at {where} measured points."
    return Drawing(arm_drawing(shown[0], shown[-1], words, reference), caption)


def _name_now(report: Report) -> str:
    return "with the full model" if report.calibration.model.family_names else "with calibrated links"


def errors_table(report: Report, told: HeadlineFacts) -> Table:
    """Table of mean, RMS and maximum of the 3D error at each stage, in one unit."""
    steps = [step.calibration for step in report.session.steps]
    columns: list[Figures] = []
    for stage in told.stages:
        evaluation = steps[-1].before if stage.step is None else steps[stage.step].after
        figures = evaluation.test if told.of_test_poses else evaluation.train
        assert figures is not None
        columns.append(figures)
    factor = 1e3 if headlines.unit(told) == "µm" else 1.0
    rows = [(name, *(numbers.digits(factor * getattr(f, key)) for f in columns)) for name, key in _FIGURES]
    if told.noise_mm is not None:
        rows.append((f"{told.noise.name}, RMS", *[""] * (len(columns) - 1), numbers.digits(factor * told.noise_mm)))
    points = numbers.count(columns[0].points, "point")
    of = f"test poses ({points} that no fit saw)" if told.of_test_poses else f"the fitted poses ({points})"
    headers = (f"3D error, {headlines.unit(told)}", *(stage.name for stage in told.stages))
    return Table(headers, rows, caption=f"Errors at {of}, all in {headlines.unit(told)}")


def what_to_do(report: Report) -> list[str]:
    """List of recommended actions in plain words, the most useful first."""
    told, found = report.session.headline, report.diagnosis
    assert told is not None
    out = [_table_to_load(report, told)]
    if report.calibration.model.family_names:
        out.append(_compensation(report, told))
    out += _confirmations(found)
    out += _to_measure(report, found)
    return out


def _table_to_load(report: Report, told: HeadlineFacts) -> str:
    errors = report.table.errors
    figures = errors.test if told.of_test_poses else errors.train
    before = told.stages[0].error_mm
    if figures is None or not figures.rmse_mm < before:
        return "Load no new table: by itself it would not make the arm better than it was delivered."
    return (
        "Load the calibrated table into the controller (robot.toml of inspector calibrate --out, or of the page's tab "
        f"Take away). By itself it takes the error from {headlines.length(told, before)} to "
        f"{headlines.length(told, figures.rmse_mm)}."
    )


def _compensation(report: Report, told: HeadlineFacts) -> str:
    families = report.calibration.model.family_names
    names = numbers.listing(["the learned curves" if name == LEARNED else name for name in families])
    correction = report.correction
    if correction is not None and correction.reached.mean() < _ADVISED:
        reached, count = int(correction.reached.sum()), len(correction.reached)
        return (
            f"No table can hold {names}, and corrected joint targets would not bring the arm there: only {reached} of "
            f"the {count} measured poses are reached by motions that a correction can be. Mend the cause on the arm, "
            "and calibrate again."
        )
    return (
        f"Compensate {names}, which no table can hold: correct the joint targets of your programs (inspector correct), "
        f"and the error goes down to {headlines.length(told, told.stages[-1].error_mm)}. Or mend the cause on the arm, "
        "and calibrate again."
    )


def _confirmations(found: Diagnosis | None) -> list[str]:
    """Sentences on the measurements that confirm each cause alone, before a gear is opened."""
    if found is None:
        return []
    confirm = {described.name: described.confirm for described in descriptions()}
    names = dict.fromkeys((*found.missing, *found.suspected, *found.ambiguous_set))
    return [f"To be sure of {name}, measure: {confirm[name]}." for name in names if confirm.get(name)]


def _to_measure(report: Report, found: Diagnosis | None) -> list[str]:
    out = []
    next_poses = report.session.next_poses
    if found is not None and next_poses is not None:
        poses = poses_to_measure(next_poses.poses[:_AGAIN], report.dataset.robot.is_revolute)
        out.append(
            f"To tell {numbers.listing(found.undecided, 'from')} apart, measure at these joints, in degrees: {poses} "
            "(inspector plan --for split plans them)."
        )
    tests = found.residual_tests if found is not None else report.session.residual_tests
    if tests is not None and tests.outlier_poses:
        poses_again = numbers.listing(list(tests.outlier_poses))
        out.append(f"Measure {poses_again} again: they stand out from all others.")
    if report.calibration.after.test is None:
        out.append(
            "Measure some poses more and give them the role test in poses.csv: nothing confirms these figures yet."
        )
    unexplained = found is not None and found.verdict == "unexplained" and found.data_problem is None
    number = found.residual_tests.strongest_joint if found is not None and unexplained else None
    if number is not None:
        out.append(f"Look at joint {number}: what has no known cause shows most in its motion.")
    if not out:
        after = report.calibration.after
        order = np.argsort(-np.linalg.norm(after.error_mm, axis=1))
        worst = list(dict.fromkeys(report.dataset.poses.ids[i] for i in after.pose[order]))[:_AGAIN]
        out.append(f"To check the arm later, measure {numbers.listing(worst)} again: they are off the most today.")
    return out
