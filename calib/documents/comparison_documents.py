"""What two calibrations differ by, and what check poses say of a cell, as the commands print it with --json."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from calib.documents.calibration_documents import by_role
from calib.documents.diagnosis_documents import data_problem_document
from calib.monitoring.change_tests import Found
from calib.monitoring.iso9283 import PoseFigures
from calib.monitoring.watch import Watched
from calib.validation.comparison import Comparison


def comparison_document(compared: Comparison) -> dict[str, Any]:
    """What `inspector compare --json` prints; sizes in mm and rad, or an effect's own unit."""
    return {
        "names": compared.names,
        "differs": compared.differs,
        "p_same": compared.p_same,
        "p_rest": compared.p_rest,
        "changes": [
            {
                "parameter": c.name, "size": c.size, "sigma": c.sigma, "unit": c.unit, "p_holm": c.p_holm,
                "alike": c.alike,
            }
            for c in compared.changes
        ],
        "parameters": [
            {
                "parameter": p.name, "unit": p.unit, "values": p.values, "sigmas": p.sigmas,
                "difference": p.difference, "sigma": p.sigma,
            }
            for p in compared.parameters
        ],
        "only_in": compared.only_in,
        "tool_point": {
            "rms_mm": compared.rms_mm, "max_mm": compared.largest_mm, "pose": compared.largest_pose,
        },
        "errors": [
            {"before": by_role(before), "after": by_role(after)} for before, after in compared.errors
        ],
        "explanation": compared.headline,
    }  # fmt: skip


def watch_document(seen: Sequence[Watched], repeats: Sequence[PoseFigures] = ()) -> dict[str, Any]:
    """What `inspector watch --json` prints: the last new dataset, all of them in order under "new", and repeats."""
    documents = [watched_document(w) for w in seen]
    return {**documents[-1], "new": documents, "iso9283": [_repeated(p) for p in repeats]}


def _repeated(pose: PoseFigures) -> dict[str, Any]:
    return {
        "pose": pose.pose,
        "sessions": [
            {"name": s.session, "pose": s.pose, "visits": s.visits, "rp_mm": s.rp_mm, "ap_mm": s.ap_mm}
            for s in pose.sessions
        ],
        "dap_mm": pose.dap_mm,
        "drp_mm": pose.drp_mm,
        "barycentre_moved_mm": pose.moved_mm,
    }


def watched_document(w: Watched) -> dict[str, Any]:
    """One new dataset as an entry of "new" in what `inspector watch --json` prints."""
    return {
        "name": w.name,
        "verdict": w.verdict,
        "changes": [asdict(change) for change in w.changes],
        "unseen": [asdict(d) for d in w.unseen],
        "detectable": [asdict(d) for d in w.detectable],
        "date": w.when,
        "usual": [_size(found) for found in w.usual],
        "limit_mm": w.errors.limit_mm,
        "rmse_mm": w.rmse_mm,
        "rmse_scanner_free_mm": w.rmse_free_mm,
        "expected_mm": w.expected_mm,
        "p_unchanged": w.p_unchanged,
        "poses": w.poses,
        "data_problem": data_problem_document(w.data_problem),
        "outside": w.outside,
        "explanation": w.headline,
    }


def _size(found: Found) -> dict[str, Any]:
    """The size of a change taken as the only one; null where these poses do not show it."""
    seen = math.isfinite(found.sigma)
    return {
        "what": found.what, "joint": found.joint, "size": found.size if seen else None,
        "sigma": found.sigma if seen else None, "unit": found.unit,
    }  # fmt: skip
