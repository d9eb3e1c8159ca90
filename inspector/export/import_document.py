"""The plan of an import as a JSON document and as lines for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from calib.dataset_import.plan import ImportPlan, PlannedColumn
from calib.dataset_import.user_files import UserFile
from calib.present.fit.dataset import first_rows, preview
from calib.rendering.text import block_text

_WIDE = 28  # of an option that is told


def plan_document(plan: ImportPlan, files: Sequence[UserFile] = ()) -> dict[str, Any]:
    """JSON document of a planned import: recognised columns, doubts and faults."""
    return {
        "robot": None if plan.robot is None else plan.robot.robot.name,
        "poses": plan.poses,
        "files": [{"file": file.path.name, "is": file.kind, "why": file.why} for file in files],
        "columns": [_column(column) for column in plan.columns],
        "recognised": plan.notes,
        "doubts": plan.doubts,
        "faults": plan.faults,
        "bad_rows": [
            {"table": row.path.name, "line": row.line, "column": row.column or None, "found": row.found}
            for row in plan.bad_rows
        ],
        "bad_rows_left_out": plan.are_left_out,
        "left_out": [asdict(row) for row in plan.left_out],
        "asked": [asdict(question) for question in plan.asked],
        "preview": None if plan.preview is None else preview(plan.preview),
    }


def question_lines(plan: ImportPlan) -> list[str]:
    """Lines for a terminal on what no file tells, with the options that answer it; [] where nothing is asked."""
    asked = [
        f"  {question.option.ljust(_WIDE)} {question.what}{f'; taken: {question.guess}' if question.guess else ''}"
        for question in plan.asked
    ]
    return ["asked, as no file tells it (import again with what you know):", *asked] if asked else []


def _column(column: PlannedColumn) -> dict[str, Any]:
    meant = column.meaning
    return {
        "table": column.table.name,
        "column": column.name,
        "examples": column.examples,
        "meaning": None if meant is None else meant.name,
        "unit": None if meant is None else meant.unit or None,
        "sign": None if meant is None else meant.sign,
        "offset": None if meant is None else meant.offset,
        "map": None if meant is None else f"{column.name}={meant}",
        "why": column.why,
    }


def plan_lines(plan: ImportPlan) -> list[str]:
    """Lines for a terminal on a planned import: columns, recognised facts, doubts."""
    rows = [("table", "column", "first value", "taken for", "why")]
    rows += [
        (
            column.table.name,
            column.name,
            column.examples[0] if column.examples else "",
            "-" if column.meaning is None else str(column.meaning),
            column.why,
        )
        for column in plan.columns
    ]
    widths = [min(max(len(row[k]) for row in rows), 24) for k in range(4)]
    table = ["  ".join([*(row[k][:24].ljust(widths[k]) for k in range(4)), row[4]]).rstrip() for row in rows]
    outcome = [] if plan.preview is None else ["", block_text(first_rows(plan.preview)), "", preview(plan.preview)]
    doubts = [f"doubtful: {doubt}" for doubt in plan.doubts]
    return [*table, "", *plan.notes, *doubts, *question_lines(plan), *outcome]
