"""What `calibrate --json`, `validate --json` and `correct --json` print. Nothing here computes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from calib.calibration.evaluation import Evaluation, Figures
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import correlated_pairs, identifiable_combinations
from calib.compensation.target_correction import Correction
from calib.dataset.dataset import Dataset
from calib.diagnosis.effect_selection import FitStep
from calib.identifiability.tool_rows import tool_rows
from calib.models.exported_table import ExportedTable
from calib.models.fitted_model import FittedModel
from calib.present.calibration import found_tool_document, stands_document
from calib.validation.cross_validation import CrossValidation
from calib.validation.learning_curve import LearningCurve


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
            for step in calibration.iteration_errors
        ],
        "converged": fit.converged,
        "worse_than_nominal": calibration.worse_than_nominal or None,
        "reason": fit.reason,
        "rank": fit.rank,
        **by_role(calibration.after),
        "before": by_role(calibration.before),
        **found_tool_document(calibration),
        "attitudes": calibration.orientation_errors
        and dict(zip(("before", "after"), map(asdict, calibration.orientation_errors), strict=True)),
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
            for c in identifiable_combinations(calibration)
        ],
        "tool": asdict(tool_rows(calibration.dataset, residual=calibration.residual, model=calibration.model)),
        "correlated": [asdict(pair) for pair in correlated_pairs(calibration)],
        "stands": stands_document(calibration),
        "outliers": calibration.outliers,
        "left_out": calibration.fitted_dataset.left_out,
        "warnings": calibration.warnings,
    }


def additions(steps: Sequence[FitStep]) -> list[dict[str, Any]]:
    """The way to a calibration: the first fit, then one for each effect that was added, with its members' sizes."""
    return [
        {
            "effect": step.effect,
            "sizes": step.selected[-1].prior_sigmas if step.selected else {},
            "sigma_mm": step.calibration.sigma_mm,
            **by_role(step.calibration.after),
        }
        for step in steps
    ]


def table_document(table: ExportedTable) -> dict[str, Any]:
    """The errors of the exported table alone, and the families of the model that it cannot hold."""
    return {**by_role(table.errors), "without_effects": table.left_out}


def by_role(evaluation: Evaluation) -> dict[str, Any]:
    """Figures of training and test poses."""

    def figures(of: Figures | None) -> dict[str, Any] | None:
        return None if of is None else asdict(of)

    return {"train": figures(evaluation.train), "test": figures(evaluation.test)}


def validation_document(folds: CrossValidation, curve: LearningCurve) -> dict[str, Any]:
    """What `validate --json` prints: held-out errors by fold and pose, the learning curve, and what they mean."""
    return {
        "dataset": folds.dataset.name,
        "residual": folds.residual,
        "left_out": folds.dataset.left_out,
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


def saved_model_document(
    fitted: FittedModel, dataset: Dataset, before: Evaluation, after: Evaluation, *, same: bool
) -> dict[str, Any]:
    """What `validate --model --json` prints: a saved model's errors at a dataset's points, and those of its fit."""
    return {
        "dataset": dataset.name,
        "model": {
            "dataset": fitted.source.dataset,
            "same_measurements": same,
            "effects": fitted.model.family_names,
            "before": asdict(fitted.before),
            **asdict(fitted.after),
        },
        "before": by_role(before),
        **by_role(after),
        "poses": after.to_frame(dataset).to_dict(orient="records"),
        "outside": fitted.outside(dataset),
        "notes": after.notes,
    }


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
