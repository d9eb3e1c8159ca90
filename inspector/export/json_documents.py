"""What the commands print with --json, by name: each is made in `calib.documents`, as `to_dict` of a result is."""

from __future__ import annotations

from calib.documents.calibration_documents import (
    correction_document,
)
from calib.documents.diagnosis_documents import document_with_poses, effects_document
from calib.present.corners import corners_document
from calib.present.redundancy import redundancy_document

__all__ = [
    "corners_document",
    "correction_document",
    "document_with_poses",
    "effects_document",
    "redundancy_document",
]
