"""What the commands print with --json, by name: each is made in `calib.documents`, as `to_dict` of a result is."""

from __future__ import annotations

from calib.documents.calibration_documents import (
    additions,
    calibration_document,
    correction_document,
    saved_model_document,
    table_document,
    validation_document,
)
from calib.documents.corner_documents import corners_document, redundancy_document
from calib.present.diagnosis import diagnosis_document as document_with_poses
from calib.present.effects import effects_document

__all__ = [
    "additions",
    "calibration_document",
    "corners_document",
    "correction_document",
    "document_with_poses",
    "effects_document",
    "redundancy_document",
    "saved_model_document",
    "table_document",
    "validation_document",
]
