"""A calibration as it is told, and the documents of the figures that others are told with."""

from __future__ import annotations

from typing import Any

from calib.calibration.evaluation import Evaluation
from calib.calibration.result import Calibration
from calib.consistency.data_problem import DataProblem
from calib.present.blocks import Block, Paragraph, Table
from calib.present.numbers import readable
from calib.present.results import document

_PLACES = 9  # of a parameter's value, beyond which there is rounding alone


@document.register
def _evaluation_document(evaluation: Evaluation) -> dict[str, Any]:
    return {"train": evaluation.train, "test": evaluation.test}


@document.register
def _data_problem_document(problem: DataProblem) -> dict[str, Any]:
    return {
        "kind": problem.kind,
        "joints": problem.joints,
        "mend": problem.remedy,
        "rmse_mm": {"now": problem.now_mm, "then": problem.then_mm},
        "words": problem.words,
    }


def found_tool_document(calibration: Calibration) -> dict[str, Any]:
    """Where the tool point was found, mm in the last joint's frame and from the tip; None where robot.toml has it."""
    shift = calibration.tool_shift
    return {
        "tool_found_mm": None if shift is None else shift.point_mm,
        "tool_found_in_tip_mm": None if shift is None else shift.in_tip_mm,
    }


def stands_document(calibration: Calibration) -> dict[str, int] | None:
    """Number of repeat groups ("stands") and of measured points ("shots"); None where no pose was measured twice."""
    count = calibration.repeat_count
    return None if count is None else {"stands": count.groups, "shots": count.repeats}


def parameters(calibration: Calibration) -> list[Block]:
    """Every parameter with its sigma; angles in degrees, as the files have them."""
    rows = []
    for row in calibration.to_frame().to_dict(orient="records"):
        unit = row["unit"]
        nominal, value, change, sigma = (
            round(readable(row[key], unit)[0], _PLACES) + 0.0 for key in ("nominal", "value", "change", "sigma")
        )
        name = f"{row['name']}{'' if row['known'] else '*'}"
        shown = (f"{nominal:.6g}", f"{value:.6g}", f"{change:+.3g}", f"{sigma:.2g}")
        rows.append((name, *shown, readable(0.0, unit)[1]))
    note = "* the data tell next to nothing of it by itself: its tolerance holds the value, or it is shared."
    columns = ("name", "nominal", "fitted", "change", "sigma", "unit")
    return [Table(columns, rows, left=(0, 5)), Paragraph(note, soft=True)]
