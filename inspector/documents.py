"""Results as JSON documents: the keys that scripts rely on. Nothing here computes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from calib.calibration import Calibration
from calib.checking import Check
from calib.corners import CornerSearch
from calib.evaluation import Evaluation, Figures
from calib.knowledge import correlated_pairs, known_sums
from calib.measurement import failed_searches
from calib.redundancy import Redundancy
from calib.repeatability import repeats_frame


def to_json(document: Mapping[str, Any]) -> str:
    """Strict JSON: numbers that are not finite become null."""
    return json.dumps(_plain(document), allow_nan=False, ensure_ascii=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def corners_document(searches: Mapping[str, CornerSearch]) -> dict[str, Any]:
    """What `corners --json` prints: the corners with their planes, and the poses without one with the reason."""
    found = []
    for pose_id, search in searches.items():
        corner = search.corner
        if corner is None:
            continue
        planes = [
            {"normal": f.normal, "offset_mm": f.offset_mm, "points": f.points, "rms_mm": f.rms_mm}
            for f in corner.faces
        ]
        found.append(
            {
                "pose": pose_id,
                "xyz_mm": corner.xyz_mm,
                "covariance_mm2": corner.covariance_mm2,
                "planes": planes,
                "seconds": search.seconds,
                "sample_sets": search.filter_counts(),
                "plane_groups": len(search.groups),
            }
        )
    failed = [{"pose": pose_id, "reason": reason} for pose_id, reason in failed_searches(searches).items()]
    return {"corners": found, "failed": failed}


def redundancy_document(redundancy: Redundancy, residual: str, rank_unknown_frame: int) -> dict[str, Any]:
    """What `redundancy --json` prints; `rank_unknown_frame` is what is left where the scanner's place is unknown."""
    return {
        "residual": residual,
        "parameters": redundancy.parameters,
        "pearson": redundancy.pearson,
        "no_influence": redundancy.no_influence,
        "groups": redundancy.groups,
        "mixed_groups": redundancy.mixed_groups,
        "combinations": [{"parameters": relation} for relation in redundancy.combinations],
        "rank": redundancy.rank,
        "rank_unknown_frame": rank_unknown_frame,
        "kept": redundancy.kept,
        "independent": redundancy.independent,
        "dropped": redundancy.dropped,
    }


def calibration_document(calibration: Calibration) -> dict[str, Any]:
    """What `calibrate --json` prints."""
    frame = calibration.to_frame()
    fit = calibration.fit
    return {
        "dataset": calibration.dataset.name,
        "residual": calibration.residual,
        "effects": [effect.name for effect in calibration.model.effects[1:]],
        "iterations": [
            {
                "rmse_mm": step.train_rmse_mm,
                "test_rmse_mm": step.test_rmse_mm,
                "distance_rmse_mm": step.train_distance_rmse_mm,
                "test_distance_rmse_mm": step.test_distance_rmse_mm,
            }
            for step in calibration.steps
        ],
        "converged": fit.converged,
        "reason": fit.reason,
        "rank": fit.rank,
        **_roles(calibration.after),
        "before": _roles(calibration.before),
        "sigma_mm": calibration.sigma_mm,
        "degrees_of_freedom": fit.degrees_of_freedom,
        "parameters": frame.to_dict(orient="records"),
        "known_sums": [
            {
                "parameters": c.coefficients,
                "value": c.value,
                "sigma": c.sigma,
                "worst_part_sigma": c.worst_part_sigma,
            }
            for c in known_sums(calibration)
        ],
        "correlated": [asdict(pair) for pair in correlated_pairs(calibration)],
        "warnings": calibration.warnings,
    }


def _roles(evaluation: Evaluation) -> dict[str, Any]:
    def figures(of: Figures | None) -> dict[str, Any] | None:
        return None if of is None else asdict(of)

    return {"train": figures(evaluation.train), "test": figures(evaluation.test)}


def check_document(check: Check) -> dict[str, Any]:
    """What `check --json` prints: the verdict, why, and all that led to it."""
    return {
        "dataset": check.dataset.name,
        "passed": check.passed,
        "reasons": check.reasons,
        "findings": [asdict(finding) for finding in check.findings],
        "repeats": repeats_frame(check.repeats).to_dict(orient="records"),
        "calibration": None if check.calibration is None else calibration_document(check.calibration),
    }
