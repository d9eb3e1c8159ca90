"""Results as JSON documents, the keys that scripts rely on; every one can be imported from here."""

from __future__ import annotations

from typing import Any

from calib.dataset.repeats import repeats_frame
from calib.validation.acceptance import Check
from inspector.export.calibration_documents import (
    additions,
    calibration_document,
    correction_document,
    saved_model_document,
    table_document,
    validation_document,
)
from inspector.export.corner_documents import corners_document, redundancy_document
from inspector.export.diagnosis_documents import diagnosis_document, effects_document

__all__ = [
    "additions",
    "calibration_document",
    "check_document",
    "corners_document",
    "correction_document",
    "diagnosis_document",
    "effects_document",
    "redundancy_document",
    "saved_model_document",
    "table_document",
    "validation_document",
]


def check_document(check: Check) -> dict[str, Any]:
    """What `check --json` prints: the verdict, why, and all that led to it."""
    return {
        "dataset": check.dataset.name,
        "passed": check.passed,
        "reasons": check.reasons,
        "warnings": check.warnings,
        "findings": [
            {
                "name": item.name,
                "passed": item.passed,
                "words": item.description,
                "warning": item.warning,
            }
            for item in check.items
        ],
        "repeats": repeats_frame(check.repeats).to_dict(orient="records"),
        "calibration": None if check.calibration is None else calibration_document(check.calibration),
        "diagnosis": None if check.diagnosis is None else diagnosis_document(check.diagnosis),
    }
