"""What the commands print with --json of a check and a diagnosis; other results have theirs in `calib.present`."""

from __future__ import annotations

from calib.documents.check_document import check_document
from calib.documents.diagnosis_documents import diagnosis_document, effects_document

__all__ = [
    "check_document",
    "diagnosis_document",
    "effects_document",
]
