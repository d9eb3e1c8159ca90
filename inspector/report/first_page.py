"""The first page of a report, for the arm's owner: its present accuracy, the causes found, what to do."""

from __future__ import annotations

from calib.calibration.model_versions import EFFECTS, model_name, versions
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.diagnosis.headline import Headline as HeadlineFacts
from calib.models.exported_table import ExportedTable
from calib.present.diagnosis.actions import plain_verdict, what_to_do
from calib.present.diagnosis.budget import budget_blocks
from calib.present.fit import errors as headlines
from calib.rendering.blocks import Block, Bullets, Drawing, KeyFigures, Paragraph, Verdict
from calib.rendering.colours import VERDICT_COLOURS
from inspector.markup.parts.palette import NEUTRAL
from inspector.report.arm_drawing import arm_drawing, stride
from inspector.session.session import Session


def first_page(session: Session, calibration: Calibration, table: ExportedTable, made: str) -> tuple[Block, ...]:
    """Blocks of a report's first page, in the order of reading. `made`: the date of the report."""
    told, diagnosis, tests = session.headline, session.diagnosis, session.residual_tests
    assert told is not None
    outliers = diagnosis.outlier_poses if diagnosis is not None else () if tests is None else tests.outlier_poses
    correction = None  # of the measured poses, where the model has what no table can hold
    if calibration.model.arm_family_names:
        poses = calibration.dataset.poses
        correction = calibration.fitted_model.correct(poses.q, poses, ids=poses.ids)
    return (
        KeyFigures(_about(calibration.dataset, made)),
        _verdict(session, calibration, told),
        headlines.error_headline(told, unexplained=diagnosis is not None and diagnosis.is_unexplained),
        *budget_blocks(session.budget),
        _picture(session, calibration, told),
        Paragraph("What to do", heading=True),
        Bullets(what_to_do(told, table, correction, diagnosis, session.next_poses, outliers)),
        headlines.errors_by_stage(told, [step.calibration for step in session.steps]),
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


def _verdict(session: Session, calibration: Calibration, told: HeadlineFacts) -> Verdict:
    found = session.diagnosis
    words = plain_verdict(told, found)
    if found is None:
        by_hand = f"No verdict: the model ({model_name(calibration.model)}) was put together by hand."
        return Verdict(f"{by_hand} {words}", NEUTRAL)
    return Verdict(words, VERDICT_COLOURS[found.verdict])


def _picture(session: Session, calibration: Calibration, told: HeadlineFacts) -> Drawing:
    shown, poses = versions(calibration, session.links_alone), calibration.dataset.poses
    first, last = told.stages[0], told.stages[-1]
    now = EFFECTS if calibration.model.family_names else "with calibrated links"
    words = (
        f"{first.name}: {headlines.length(told, first.error_mm)}",
        f"{now}: {headlines.length(told, last.error_mm)}",
    )
    count, every = len(shown[0].evaluation.pose), stride(len(shown[0].evaluation.pose))
    where = f"all {count}" if every == 1 else f"{-(-count // every)} of {count}"
    role = "test poses" if told.of_test_poses else "fitted poses"
    caption = (
        f"The arm at pose {poses.ids[poses.reference]}, {first.name} on the left and {now} on the right, with the "
        f"error at {where} measured points, enlarged equally in both. The figures named are RMS at the {role}."
    )
    return Drawing(arm_drawing(shown[0], shown[-1], words, poses.reference), caption)
