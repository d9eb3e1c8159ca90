"""What two calibrations differ by, as the command prints it with --json."""

from __future__ import annotations

from typing import Any

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
