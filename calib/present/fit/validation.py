"""Presentation of a model's errors at poses outside its fit: cross-validation, learning curve, saved model."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from calib.calibration.evaluation import Evaluation
from calib.calibration.model_versions import model_name
from calib.dataset.dataset import Dataset
from calib.models.fitted_model import FittedModel
from calib.present.fit.errors import coverage_sentence, error_table, promise_document, sigma_sentence
from calib.present.results import document, keys_of, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Bullets, Facts, FigurePlace, Paragraph, Presentation, Table, Verdict
from calib.rendering.colours import BAD, DOUBT, GOOD
from calib.validation.cross_validation import FAR, SUSPICIOUS, CrossValidation, LearningCurve

# ---- cross-validation -----------------------------------------------------------------------------------------------


@presentation.register
def _cross_validation(folds: CrossValidation) -> Presentation:
    head = [*cross_validation_blocks(folds), cross_validation_verdict(folds)]
    return Presentation(f"Cross-validation of {folds.dataset.name}", head)


def cross_validation_blocks(folds: CrossValidation) -> list[Block]:
    """Blocks on cross-validation: held-out errors, their spread over the folds, and the share due to noise."""
    each = [fold.held_out.rmse_mm for fold in folds.folds]
    poses = numbers.count(len(np.unique(folds.after.pose)), "training pose")
    facts: list[tuple[str, object]] = [
        ("cross-validation", f"{len(folds.folds)} folds over {poses}, {folds.residual} residual"),
        ("held-out RMSE of the folds", f"{numbers.length(min(each))} to {numbers.length(max(each))}"),
        ("their spread", numbers.length(folds.spread_mm)),
        ("training RMSE", numbers.length(folds.whole.after.train_rmse_mm)),
        ("held-out over training RMSE", numbers.digits(folds.ratio)),
        ("of which noise explains", numbers.digits(folds.expected_ratio)),
    ]
    return [
        Facts(facts),
        error_table(folds.before, folds.after, test="held-out"),
        Paragraph(sigma_sentence(folds.sigma)),
        Bullets(folds.notes),
    ]


def cross_validation_verdict(folds: CrossValidation) -> Verdict:
    """Verdict on the held-out errors."""
    words, colour = "Poses left out come out as well as noise allows: the fit does not bend to its own poses", GOOD
    if not folds.held_out.rmse_mm < folds.before.test_rmse_mm:
        colour = BAD
        words = "The calibration does not help: poses it did not see are no better than as delivered."
    elif not all(fold.converged for fold in folds.folds):
        words, colour = "Not every fold's fit converged: do not trust these figures.", BAD
    elif folds.ratio > SUSPICIOUS * folds.expected_ratio:
        colour = DOUBT
        words = (
            "The fit does better on its own poses than parameters and noise explain: too few poses, or physics that is "
            "not in the model; expect the held-out error, not the training error, elsewhere."
        )
    elif folds.sigma.verdict == "excess":
        colour = DOUBT
        words += (
            "; that holds for poses like the training poses, and since more than noise is left, the error elsewhere "
            "can be larger: look at test poses of another kind."
        )
    else:
        words += "; expect the held-out error at poses like these."
    return Verdict(words, colour)


# ---- learning curve -------------------------------------------------------------------------------------------------


@presentation.register
def _learning_curve(curve: LearningCurve) -> Presentation:
    caption = "RMSE by the number of training poses."
    figure = FigurePlace("learning_curve", (curve,), caption, height_px=300)
    head = [*learning_curve_blocks(curve), learning_curve_verdict(curve), figure]
    return Presentation(f"Learning curve of {curve.dataset.name}", head)


def learning_curve_blocks(curve: LearningCurve) -> list[Block]:
    """Blocks with the errors by the number of training poses."""
    rows = [
        (
            step.poses,
            *map(numbers.column_mm, (step.train_rmse_mm, step.held_out_rmse_mm, step.spread_mm, step.sigma_mm)),
        )
        for step in curve.steps
    ]
    columns = ("training poses", "training RMSE, mm", "held-out RMSE, mm", "spread, mm", "residual sigma, mm")
    caption = f"learning curve, {curve.residual} residual, held out: {curve.held_out}"
    return [
        Table(columns, rows, caption=caption, left=()),
        Paragraph(sigma_sentence(curve.sigma)),
        Bullets(curve.notes),
    ]


def learning_curve_verdict(curve: LearningCurve) -> Verdict:
    """Verdict on whether more poses would help, and on the error that would remain."""
    last = curve.steps[-1]
    words, colour = _more_poses(curve)
    ratio = last.held_out_rmse_mm / last.train_rmse_mm if last.train_rmse_mm > 0.0 else 1.0
    if ratio >= FAR:
        words += (
            f"; the held-out error is {numbers.times(ratio)} the training error: such poses are not among the training "
            "poses, or the physics that is missing shows there"
        )
    return Verdict(f"{words}.", colour)


def _more_poses(curve: LearningCurve) -> tuple[str, str]:
    last, sigma, since = curve.steps[-1], curve.sigma, curve.flat_since
    excess = sigma.verdict == "excess"
    ratio = sigma.sigma_mm / sigma.declared_mm if sigma.declared_mm else math.nan
    missing = (
        f"the residual is {numbers.times(ratio)} the declared sigma: physics is missing from the model, or sigma was "
        "declared too small"
        if excess
        else ""
    )
    if since is None:
        words = (
            f"More poses would still help: twice as many ({2 * last.poses}) promise a held-out error of about "
            f"{numbers.length(curve.doubled_rmse_mm)} instead of {numbers.length(last.held_out_rmse_mm)} "
            f"({numbers.MINUS}{numbers.share(curve.gain)})"
        )
        return (f"{words}; besides, {missing}" if excess else words), DOUBT
    words = f"Flat since {since} poses at {numbers.length(last.held_out_rmse_mm)}: more poses will not help"
    if excess:
        return f"{words}; {missing}", DOUBT
    if sigma.verdict == "unknown":
        unknown = "without a declared sigma the curve does not show whether noise or missing physics is left"
        return f"{words}; {unknown}", DOUBT
    return f"{words}, and none are needed: the residual shows nothing but the declared noise", GOOD


# ---- a saved model --------------------------------------------------------------------------------------------------


@presentation.register
def _fitted_model(fitted: FittedModel) -> Presentation:
    return Presentation(f"Model of {fitted.source.dataset}", model_blocks(fitted))


def model_blocks(fitted: FittedModel) -> list[Block]:
    """Blocks on a saved model, with the errors of its fit."""
    without = f" without {', '.join(fitted.source.left_out)}" if fitted.source.left_out else ""
    return [
        Paragraph(f"{numbers.capitalised(model_name(fitted.model))}, fitted to {fitted.source.dataset}{without}."),
        error_table(fitted.before, fitted.after),
    ]


def saved_model_blocks(fitted: FittedModel, dataset: Dataset, before: Evaluation, after: Evaluation) -> list[Block]:
    """Blocks on a saved model, with its errors at the points of a dataset."""
    same = fitted.is_fitted_to(dataset)
    which = "the measurements that it was fitted to" if same else "not the files that it was fitted to"
    trained = fitted.trained
    outside = trained.words(dataset.robot, dataset.poses.q, dataset.poses.ids) if trained is not None else ""
    return [
        *model_blocks(fitted),
        Paragraph(f"At {dataset.name}, {which}:"),
        error_table(before, after),
        Paragraph(coverage_sentence(fitted.promise(dataset, after))),
        Bullets([*([f"{numbers.capitalised(outside)}."] if outside else []), *after.notes]),
    ]


# ---- documents ------------------------------------------------------------------------------------------------------


def validation_document(folds: CrossValidation, curve: LearningCurve) -> dict[str, Any]:
    """Document that `validate --json` prints: held-out errors by fold and pose, learning curve, and verdicts."""
    return {**document(folds), "learning_curve": document(curve), "notes": [*folds.notes, *curve.notes]}


@document.register
def _cross_validation_document(folds: CrossValidation) -> dict[str, Any]:
    return {
        **keys_of(folds, "residual", "held_out", "spread_mm", "ratio", "expected_ratio", "folds", "notes"),
        "dataset": folds.dataset.name,
        "left_out": folds.dataset.left_out,
        "before": folds.before.test,
        "train": folds.whole.after.train,
        "poses": folds.to_frame(),
        "sigma": {**document(folds.sigma), "verdict": folds.sigma.verdict},
        "explanation": cross_validation_verdict(folds).words,
    }


@document.register
def _learning_curve_document(curve: LearningCurve) -> dict[str, Any]:
    return {
        **keys_of(curve, "held_out", "flat_since", "doubled_rmse_mm", "gain"),
        "steps": curve.to_frame(),
        "explanation": learning_curve_verdict(curve).words,
    }


@document.register
def _model_document(fitted: FittedModel) -> dict[str, Any]:
    return {
        "dataset": fitted.source.dataset,
        "effects": fitted.model.family_names,
        "before": fitted.before,
        **keys_of(fitted.after, "train", "test"),
    }


def _poses_of_model(fitted: FittedModel, dataset: Dataset, after: Evaluation) -> dict[str, Any]:
    """Keys `poses` and `coverage_90`, each pose with setup, predicted minus measured by axis, and distance error."""
    promised = promise_document(fitted.promise(dataset, after), dataset.poses)
    rows = after.to_frame(dataset).drop(columns="error_mm").to_dict("records")
    return promised | {"poses": [row | own for row, own in zip(rows, promised["poses"], strict=True)]}


def saved_model_document(
    fitted: FittedModel, dataset: Dataset, before: Evaluation, after: Evaluation
) -> dict[str, Any]:
    """Document that `validate --model --json` prints: a saved model's errors at a dataset's points and at its fit."""
    return {
        "dataset": dataset.name,
        "model": {**document(fitted), "same_measurements": fitted.is_fitted_to(dataset)},
        "before": before,
        **document(after),
        **_poses_of_model(fitted, dataset, after),
        "outside": fitted.outside(dataset),
        "notes": after.notes,
    }
