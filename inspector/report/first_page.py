"""The first page of a report, for the arm's owner: its present accuracy, the causes found, what to do."""

from __future__ import annotations

from calib.calibration.model_versions import versions
from calib.dataset.dataset import Dataset
from calib.diagnosis.headline import Headline as HeadlineFacts
from calib.present.cause.actions import plain_verdict, what_to_do
from calib.present.cause.budget import budget_blocks
from calib.present.effects import model_name
from calib.present.fit import errors as headlines
from calib.rendering.blocks import Block, Bullets, Drawing, KeyFigures, Paragraph, Verdict
from calib.rendering.colours import VERDICT_COLOURS
from inspector.markup.parts.palette import NEUTRAL
from inspector.report.arm_drawing import arm_drawing, stride
from inspector.report.content import Report


def first_page(report: Report, made: str) -> tuple[Block, ...]:
    """Blocks of a report's first page, in the order of reading. `made`: the date of the report."""
    session = report.session
    told, diagnosis = session.headline, session.diagnosis
    assert told is not None
    tests = session.residual_tests if diagnosis is None else diagnosis.residual_tests
    return (
        KeyFigures(_about(report.dataset, made)),
        _verdict(report, told),
        headlines.error_headline(told, unexplained=diagnosis is not None and diagnosis.is_unexplained),
        *budget_blocks(session.budget),
        _picture(report, told),
        Paragraph("What to do", heading=True),
        Bullets(
            what_to_do(
                told,
                report.table,
                report.correction,
                diagnosis,
                session.next_poses,
                diagnosis.outlier_poses if diagnosis is not None else () if tests is None else tests.outlier_poses,
            )
        ),
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


def _verdict(report: Report, told: HeadlineFacts) -> Verdict:
    found = report.diagnosis
    words = plain_verdict(told, found)
    if found is None:
        by_hand = f"No verdict: the model ({model_name(report.calibration)}) was put together by hand."
        return Verdict(f"{by_hand} {words}", NEUTRAL)
    return Verdict(words, VERDICT_COLOURS[found.verdict])


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
    role = "test poses" if told.of_test_poses else "fitted poses"
    caption = (
        f"The arm at pose {pose}, {first.name} on the left and {_name_now(report)} on the right, with the error at "
        f"{where} measured points, enlarged equally in both. The figures named are RMS at the {role}."
    )
    return Drawing(arm_drawing(shown[0], shown[-1], words, reference), caption)


def _name_now(report: Report) -> str:
    return "with the full model" if report.calibration.model.family_names else "with calibrated links"
