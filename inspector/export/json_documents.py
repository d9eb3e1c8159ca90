"""What the commands print with --json of a check and a diagnosis; other results have theirs in `calib.present`."""

from __future__ import annotations

from calib.documents.diagnosis_documents import document_with_poses, effects_document

__all__ = [
    "document_with_poses",
    "effects_document",
]
