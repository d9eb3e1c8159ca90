"""What `calibrate --json`, `validate --json` and `correct --json` print. Nothing here computes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calib.compensation.target_correction import Correction


def correction_document(correction: Correction, ids: Sequence[str]) -> dict[str, Any]:
    """What `correct --json` prints: each target with its errors, and those that cannot be reached with the reason."""
    commanded = correction.robot.commands_of(correction.q)
    targets = [
        {"pose": pose, **row, "q": q if row["reached"] else None}
        for pose, row, q in zip(ids, correction.to_frame().to_dict(orient="records"), commanded, strict=True)
    ]
    missed = [(pose, why) for pose, why in zip(ids, correction.reasons, strict=True) if why]
    outside = correction.is_outside
    return {
        "what": correction.kind,
        "reached": int(correction.reached.sum()),
        "not_reached": [{"pose": pose, "why": why} for pose, why in missed],
        "largest_move_deg": correction.largest_move_deg,
        "outside": None if outside is None else [pose for pose, is_out in zip(ids, outside, strict=True) if is_out],
        "attitude": correction.attitude_words or None,
        "as_after_last_pose": correction.changed,
        "q_units": ["rad" if turns else "mm" for turns in correction.robot.is_revolute],
        "targets": targets,
        "unreached": [{"pose": pose, "reason": why} for pose, why in missed],
    }
