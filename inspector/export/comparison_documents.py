"""What two calibrations differ by, and what check poses say of a cell, as the commands print it with --json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from calib.monitoring.watch import Watched
from calib.validation.comparison import Comparison
from inspector.export.calibration_documents import by_role


def comparison_document(compared: Comparison) -> dict[str, Any]:
    """Of `inspector compare --json`; sizes in mm and rad, or an effect's own unit."""
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


def watch_document(seen: Sequence[Watched]) -> dict[str, Any]:
    """Of `inspector watch --json`: the last of the new datasets, and all of them in order under "new"."""
    documents = [_watched(w) for w in seen]
    return {**documents[-1], "new": documents}


def _watched(w: Watched) -> dict[str, Any]:
    return {
        "name": w.name,
        "verdict": w.verdict,
        "changes": [asdict(change) for change in w.changes],
        "unseen": [asdict(d) for d in w.unseen],
        "detectable": [asdict(d) for d in w.detectable],
        "rmse_mm": w.rmse_mm,
        "rmse_scanner_free_mm": w.rmse_free_mm,
        "expected_mm": w.expected_mm,
        "p_unchanged": w.p_unchanged,
        "poses": w.poses,
        "explanation": w.headline,
    }
