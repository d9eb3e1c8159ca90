"""Results as JSON documents: the keys that scripts rely on. Nothing here computes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from calib.calibration.calibrate import Calibration
from calib.calibration.evaluation import Evaluation, Figures
from calib.calibration.uncertainty import correlated_pairs, known_sums
from calib.compensation.target_correction import Correction
from calib.corners.search import CornerSearch
from calib.dataset.repeats import repeats_frame
from calib.diagnosis.effect_selection import Addition
from calib.diagnosis.explanation import explain
from calib.diagnosis.fault_models import LocalFault
from calib.diagnosis.pose_recommendation import splitting_poses
from calib.diagnosis.screening import Candidate
from calib.diagnosis.stepwise import Diagnosis, Step
from calib.effects.catalogue import descriptions
from calib.identifiability.redundancy import Redundancy
from calib.identifiability.structural import PlaceUnknown
from calib.measurement.labels import FaceLabels
from calib.measurement.measured_points import failed_searches
from calib.validation.acceptance import Check
from calib.validation.cross_validation import CrossValidation
from calib.validation.learning_curve import LearningCurve


def corners_document(searches: Mapping[str, CornerSearch], labels: FaceLabels) -> dict[str, Any]:
    """What `corners --json` prints: the corners with their planes, the jig's orientations, and what failed and why."""

    def scan(pose_id: str) -> dict[str, int | None]:
        count = searches[pose_id].count
        if count is None:
            return {"points": None, "dropped_points": None}
        return {"points": count.points, "dropped_points": count.dropped}

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
                **scan(pose_id),
                "sample_sets": search.filter_counts(),
                "plane_groups": len(search.groups),
                "quality": corner.quality.document(),
            }
        )
    failed = [
        {"pose": pose_id, "reason": reason, **scan(pose_id)}
        for pose_id, reason in failed_searches(searches).items()
    ]
    return {"corners": found, "failed": failed, "orientations": labels.document()}


def redundancy_document(redundancy: Redundancy, unknown: PlaceUnknown) -> dict[str, Any]:
    """What `redundancy --json` prints; `unknown` is what is left where the scanner's place is unknown."""
    return {
        "residual": unknown.residual,
        "seen_by": redundancy.seen,
        "parameters": redundancy.parameters,
        "pearson": redundancy.pearson,
        "no_influence": redundancy.no_influence,
        "groups": redundancy.groups,
        "mixed_groups": redundancy.mixed_groups,
        "combinations": [{"parameters": relation} for relation in redundancy.combinations],
        "rank": redundancy.rank,
        "rank_unknown_frame": unknown.best[unknown.residual],
        "rank_unknown_frame_here": unknown.here,
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
        "effects": calibration.model.family_names,
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
        "attitudes": calibration.attitudes
        and dict(zip(("before", "after"), map(asdict, calibration.attitudes), strict=True)),
        "faces_named": calibration.faces_named or None,
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


def additions(steps: Sequence[Addition]) -> list[dict[str, Any]]:
    """The way to a calibration: the first fit, then one for each effect that was added, with its members' sizes."""
    return [
        {
            "effect": step.name,
            "sizes": step.added[-1].sizes if step.added else {},
            "sigma_mm": step.calibration.sigma_mm,
            **_roles(step.calibration.after),
        }
        for step in steps
    ]


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
        "warnings": check.warnings,
        "findings": [asdict(finding) for finding in check.findings],
        "repeats": repeats_frame(check.repeats).to_dict(orient="records"),
        "calibration": None if check.calibration is None else calibration_document(check.calibration),
        "diagnosis": None if check.diagnosis is None else diagnosis_document(check.diagnosis),
    }


def validation_document(folds: CrossValidation, curve: LearningCurve) -> dict[str, Any]:
    """What `validate --json` prints: held-out errors by fold and pose, the learning curve, and what they mean."""
    return {
        "dataset": folds.dataset.name,
        "residual": folds.residual,
        "held_out": asdict(folds.held_out),
        "before": None if folds.before.test is None else asdict(folds.before.test),
        "train": None if folds.whole.after.train is None else asdict(folds.whole.after.train),
        "spread_mm": folds.spread_mm,
        "ratio": folds.ratio,
        "expected_ratio": folds.expected_ratio,
        "folds": [asdict(fold) for fold in folds.folds],
        "poses": folds.to_frame().to_dict(orient="records"),
        "sigma": {**asdict(folds.sigma), "verdict": folds.sigma.verdict},
        "learning_curve": {
            "held_out": curve.held_out,
            "steps": curve.to_frame().to_dict(orient="records"),
            "flat_since": curve.flat_since,
            "doubled_rmse_mm": curve.doubled_rmse_mm,
            "gain": curve.gain,
            "explanation": curve.meaning,
        },
        "explanation": folds.meaning,
        "notes": [*folds.notes, *curve.notes],
    }


def correction_document(correction: Correction, ids: Sequence[str]) -> dict[str, Any]:
    """What `correct --json` prints: each target with its errors, and those that cannot be reached with the reason."""
    targets = [
        {"pose": pose, **row, "q": q}
        for pose, row, q in zip(
            ids, correction.to_frame().to_dict(orient="records"), correction.q, strict=True
        )
    ]
    return {
        "what": correction.what,
        "q_units": ["rad" if turns else "mm" for turns in correction.robot.is_revolute],
        "targets": targets,
        "unreached": [
            {"pose": target["pose"], "reason": target["reason"]}
            for target in targets
            if not target["reached"]
        ],
    }


def diagnosis_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """What `diagnose --json` prints: the verdict, the steps, the ranking and what is left."""
    remains = diagnosis.remains
    return {
        "dataset": diagnosis.calibration.dataset.name,
        "verdict": diagnosis.verdict,
        "missing": diagnosis.missing,
        "ambiguous_set": diagnosis.ambiguous_set,
        "refused": diagnosis.refused or None,
        "steps": [_step(step) for step in diagnosis.steps],
        "candidates": [_candidate(candidate) for candidate in diagnosis.candidates],
        "untestable": [
            {"effect": u.name, "why": u.why, "would_help": u.would_help} for u in diagnosis.untestable
        ],
        "leftover": {
            "lack_of_fit_p": remains.lack_of_fit_p,
            "noise_mm": remains.noise_mm,
            "noise_from": remains.noise_from,
            "residual_mm": remains.residual_mm,
            "inputs": [asdict(test) for test in remains.inputs],
            "outlier_poses": remains.outlier_poses,
            "fault": _fault(remains.fault),
        },
        "simpler": _fault(diagnosis.simpler),
        "measure_next": [
            {"q": pose.q, "separation_mm": pose.separation_mm} for pose in splitting_poses(diagnosis)
        ],
        "explanation": explain(diagnosis),
    }


def _fault(fault: LocalFault | None) -> dict[str, Any] | None:
    """A dent, a slip or an unknown motion of one joint, counted from 1 as in the words."""
    if fault is None:
        return None
    return {**asdict(fault), "joint": fault.joint + 1, "words": fault.words}


def _step(step: Step) -> dict[str, Any]:
    after = step.calibration.after
    return {
        "effect": step.effect,
        "train_rmse_mm": after.train.rmse_mm if after.train else None,
        "test_rmse_mm": after.test.rmse_mm if after.test else None,
        "sigma_mm": step.calibration.sigma_mm,
        "p_value": step.p_value,
        "log_evidence_margin": step.log_evidence_margin,
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    return {
        "effect": candidate.name,
        "p_value": candidate.p_value,
        "p_holm": candidate.p_holm,
        "log_evidence": candidate.log_evidence,
        "explained_share": candidate.explained_share,
        "cv_rmse_mm": candidate.cv_rmse_mm,
        "overlaps": candidate.overlaps,
        "parameters": [asdict(value) for value in candidate.values],
        "note": candidate.family.note or None,
    }


def effects_document() -> dict[str, Any]:
    """What `effects --json` prints: the catalogue."""
    return {
        "effects": [
            {
                "name": d.name,
                "equation": d.equation,
                "parameters": [{"name": name, "unit": unit} for name, unit in d.symbols],
                "needs": d.needs,
            }
            for d in descriptions()
        ]
    }
