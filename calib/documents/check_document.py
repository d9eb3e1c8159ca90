"""A check of a dataset as the command prints it with --json."""

from __future__ import annotations

from typing import Any

from calib.dataset.repeats import repeats_frame
from calib.documents.diagnosis_documents import diagnosis_document
from calib.present.calibration import calibration_document
from calib.validation.acceptance import Check


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
