"""What `diagnose --json` and `effects --json` print. Nothing here computes."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from calib.consistency.data_problem import DataProblem
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.explanation import noise_told
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.verdict import ConfoundedSet, LearnedModel
from calib.diagnosis.words.noise_text import NoiseShaped, noise_text
from calib.diagnosis.words.phrases import fault_text
from calib.diagnosis.words.text import explanation_text
from calib.effects.catalogue import descriptions
from calib.planning.discrimination import NextPoses, explanation_of, next_poses
from calib.present.calibration import found_tool_document, stands_document
from calib.screening.candidates import Candidate
from calib.screening.residual_tests import InputTest
from calib.screening.smooth_motions import JointFault


def diagnosis_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """What `diagnose --json` prints: verdict, steps, ranking, tests of the residual, poses to measure next."""
    return document_with_poses(diagnosis, next_poses(diagnosis))


def document_with_poses(diagnosis: Diagnosis, poses: NextPoses | None) -> dict[str, Any]:
    """What `diagnose --json` prints, with poses that were chosen already (`next_poses`)."""
    residual_tests = diagnosis.residual_tests
    return {
        "dataset": diagnosis.calibration.dataset.name,
        "stands": stands_document(diagnosis.calibration),
        "left_out": diagnosis.calibration.fitted_dataset.left_out,
        **found_tool_document(diagnosis.calibration),
        "worse_than_nominal": diagnosis.calibration.worse_than_nominal or None,
        "verdict": diagnosis.verdict,
        "missing": diagnosis.missing,
        "suspected": diagnosis.suspected,
        "ambiguous_set": diagnosis.ambiguous_set,
        "open_sets": [_confounded_set(confounded) for confounded in diagnosis.confounded_sets],
        "refused": None if diagnosis.refused is None else diagnosis.refused.effect,
        "refused_why": None if diagnosis.refused is None else diagnosis.refused.why,
        "promise": None
        if diagnosis.held_out is None
        else asdict(diagnosis.held_out) | {"kept": not diagnosis.held_out.is_broken},
        "steps": [_step(step) for step in diagnosis.steps],
        "candidates": [_candidate(candidate) for candidate in diagnosis.candidates],
        "untestable": [{"effect": u.name, "why": u.why, "would_help": u.would_help} for u in diagnosis.untestable],
        "leftover": {
            "lack_of_fit_p": residual_tests.lack_of_fit_p,
            "noise_mm": residual_tests.noise_mm,
            "noise_from": residual_tests.noise_from,
            "residual_mm": residual_tests.residual_mm,
            "inputs": [_input_test(test) for test in residual_tests.inputs],
            "outlier_poses": residual_tests.outlier_poses,
            "fault": _fault(residual_tests.fault),
            "masses_log_evidence": residual_tests.masses_evidence,
        },
        "simpler": None,  # was a dent or a slip, which are effects now
        "measure_next": []
        if poses is None
        else [{"q": pose.q, "separation_mm": pose.separation_mm} for pose in poses.poses],
        "explanation": explanation_text(explanation_of(diagnosis, poses)),
        "outside": diagnosis.calibration.outside,
        "learned": _learned(diagnosis.learned),
        "noise": _noise(noise_told(diagnosis)),
        "data_problem": data_problem_document(diagnosis.data_problem),
    }


def data_problem_document(problem: DataProblem | None) -> dict[str, Any] | None:
    """What is wrong with the data or the table, and the mend; null where nothing is."""
    if problem is None:
        return None
    return {
        "kind": problem.kind,
        "joints": problem.joints,
        "mend": problem.remedy,
        "rmse_mm": {"now": problem.now_mm, "then": problem.then_mm},
        "words": problem.words,
    }


def _noise(noise: NoiseShaped | None) -> dict[str, Any] | None:
    """The noise's shape, where it is not as declared; what does not show is null."""
    if noise is None:
        return None
    shape, wander = noise.shape, noise.shape.wander
    return {
        "isotropic_mm": noise.isotropic_mm,
        "axes_mm": noise.axes_mm,
        "growth_per_m": shape.growth_per_m or None,
        "correlation_s": wander.time if wander is not None and not wander.in_poses else None,
        "correlation_poses": wander.time if wander is not None and wander.in_poses else None,
        "wander_share": wander.share if wander is not None else None,
        "tail": shape.tail,
        "rival": noise.rival or None,
        "from": "repeats" if noise.from_repeats else "fit",
        "words": noise_text(noise),
    }


def _learned(learned: LearnedModel | None) -> dict[str, Any] | None:
    if learned is None:
        return None
    train, test = learned.after.after.train, learned.after.after.test
    return {
        "joints": learned.joints,
        "inputs": learned.inputs,
        "formula": learned.formula,
        "train_rmse_mm": train.rmse_mm if train else None,
        "test_rmse_mm": test.rmse_mm if test else None,
        "share": learned.share,
    }


def _fault(fault: JointFault | None) -> dict[str, Any] | None:
    """An unknown motion of one joint, counted from 1 as in the words."""
    if fault is None:
        return None
    once = {"place_rad": None, "width_rad": None, "pose_id": ""}  # of a dent or a slip, which are effects now
    return {**asdict(fault), **once, "joint": fault.joint + 1, "words": fault_text(fault)}


def _input_test(test: InputTest) -> dict[str, Any]:
    return {"input": test.input, "p_value": test.p_value, "where": test.channel.name}


def _confounded_set(confounded: ConfoundedSet) -> dict[str, Any]:
    return {
        "effect": confounded.effect,
        "twins": confounded.equivalent,
        "untested": confounded.untested,
        "would_help": confounded.would_help,
    }


def _step(step: FitStep) -> dict[str, Any]:
    after = step.calibration.after
    return {
        "effect": step.effect,
        "train_rmse_mm": after.train.rmse_mm if after.train else None,
        "test_rmse_mm": after.test.rmse_mm if after.test else None,
        "sigma_mm": step.calibration.sigma_mm,
        "p_value": step.candidate.p_value if step.candidate else None,
        "log_evidence_margin": step.log_bayes_factor,
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
