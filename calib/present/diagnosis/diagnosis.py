"""Presentation of a diagnosis: error by stage, verdict, reasons, ranking, and the keys of `diagnose --json`."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from calib.array_types import BoolArray
from calib.calibration.promise import promise
from calib.calibration.result import Calibration
from calib.calibration.table_doubts import doubtful_entries
from calib.consistency.leading_entry import leading_entry
from calib.diagnosis.causes import FittedValue, fitted_values, visible_mm
from calib.diagnosis.decision_rules import left_to_curves, may_be_curves
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.headline import headline_of
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.verdict import ConfoundedSet, LearnedModel, Refusal
from calib.identifiability.structural import redundancy_of
from calib.planning.discrimination import DiscriminatingPose, NextPoses, next_poses
from calib.present.diagnosis.budget import budget_blocks, budget_document, probability_document, probability_sentence
from calib.present.diagnosis.candidates import ranking, untestable_blocks
from calib.present.diagnosis.interventions import intervention_sections, intervention_sentences, proven_document
from calib.present.diagnosis.noise import noise_document, noise_sentences
from calib.present.diagnosis.signals import drive_sections, drive_sentences, signals_document
from calib.present.diagnosis.verdict import curves, fault, laws, verdict
from calib.present.effects import meaning, with_key
from calib.present.fit.calibration import (
    camera_sections,
    found_tool_document,
    parameters,
    stands_document,
    tool_mass_question,
    tool_shift_sentence,
    worsening_sentence,
)
from calib.present.fit.dataset import NOT_SEARCHED, measured_blocks
from calib.present.fit.errors import (
    HELD_OUT,
    ErrorChange,
    coverage_sentence,
    error_headline,
    pose_errors,
    promise_document,
    step_table,
)
from calib.present.fit.learned import (
    coupling_sentences,
    law_sentences,
    laws_document,
    learned_section,
    reading_phrase,
    readings_document,
)
from calib.present.fit.redundancy import redundancy_section
from calib.present.fit.residuals import residual_blocks, residuals_of
from calib.present.names import input_name
from calib.present.results import document, headline, keys_of, own_fields, presentation, statement, to_dict
from calib.rendering import numbers
from calib.rendering.blocks import (
    Block,
    Bullets,
    FigurePlace,
    Paragraph,
    Presentation,
    Section,
    Verdict,
    Words,
    capitalised,
    effect,
    effects,
    joined,
    listed,
    plain,
    pose,
    spans,
)
from calib.rendering.colours import VERDICT_COLOURS
from calib.screening.candidates import MIN_LOG_BAYES_FACTOR, Candidate
from calib.screening.curves.fitted_curves import members_of_one_input
from calib.screening.curves.law_readings import law_readings
from calib.screening.curves.readings import coupling_readings, curve_readings
from calib.screening.curves.smooth_joint_error import LEARNED, is_law
from calib.screening.nuisance import REPORTED_EVIDENCE
from calib.screening.residual_tests import InputTest, ResidualTests
from calib.screening.scan_statistic import LENGTH as ALONG_LENGTH
from calib.screening.smooth_motions import JointFault

HOW, HISTORY, DATASET = "How the verdict was reached", "Error history", "Dataset and how it was measured"
MISSING, RESIDUAL = "What could be missing", "Where the model is off"
BY_POSE, PARAMETERS, NEXT = "Residual by pose", "Parameters", "What to do next"
_SIGN = re.compile(r" ([+-])(?=[^ =])")  # of a formula's term
RANKED, BRIEFLY_RANKED = 12, 5  # candidates that are listed
_SHOWN_VALUES = 4  # fitted parameters of an effect that are listed; the others are counted
_SHOWN_POSES = 3
_SAME = 0.1  # by which two sigmas of one residual may differ and be told as one
_STANDING = {"claimed": "Missing: ", "suspected": "Suspected: ", "open": "Missing, this effect or one like it: "}
_REFUSALS = {
    "nature": "{}: it was not added. Something else makes what it would explain.",
    "test poses": (
        f"with it the {HELD_OUT} are predicted worse: it was not added. Either it stands in for another cause, or the "
        "test poses differ from the others."
    ),
    "no gain": (
        "poses that were left out, the test poses and the training poses one by one, are predicted no better with it "
        "beyond chance: it was not added."
    ),
}
_NOISE_SOURCES = {
    "repeats": "by repeated measurements",
    "dataset": "as declared for the points, taken as accurate to 25 %",
    "fit": "as the fit estimates it: none is declared",
}


# ---- the whole ------------------------------------------------------------------------------------------------------


@presentation.register
def _diagnosis(diagnosis: Diagnosis) -> Presentation:
    return diagnosis_presentation(diagnosis, next_poses(diagnosis))


@headline.register
def _headline(diagnosis: Diagnosis) -> str:
    return plain(verdict_block(diagnosis).words)  # without the poses to measure next, whose choice takes a while


def diagnosis_presentation(diagnosis: Diagnosis, poses: NextPoses | None) -> Presentation:
    """Presentation of a diagnosis, with the next poses to measure where they were chosen already."""
    name, last = diagnosis.calibration.dataset.name, diagnosis.calibration
    history = FigurePlace("error_history", (diagnosis,), "3D RMSE after each change of the model.", height_px=260)
    return Presentation(
        f"Diagnosis of {name}",
        [*diagnosis_head(diagnosis), history],
        [
            Section(HOW, reasons(diagnosis, poses), brief=True),
            *intervention_sections(diagnosis),
            *drive_sections(last.dataset.robot),
            Section(HISTORY, [step_table(diagnosis.steps), Paragraph(coverage_sentence(promise(last)))], brief=True),
            *camera_sections(last),
            Section(DATASET, measured_blocks(last, NOT_SEARCHED)),
            Section(MISSING, ranked_effects(diagnosis), brief=True),
            Section(RESIDUAL, residual_blocks(residuals_of(diagnosis))),
            *learned_section(last),
            Section(BY_POSE, [pose_errors(last)]),
            redundancy_section(redundancy_of(last.dataset, residual=last.residual)),
            Section(PARAMETERS, parameters(last)),
        ],
    )


def diagnosis_head(diagnosis: Diagnosis) -> list[Block]:
    """Blocks with the error at each stage, its division between the causes, and the verdict."""
    way = headline_of([step.calibration for step in diagnosis.steps])
    return [
        error_headline(way, unexplained=diagnosis.is_unexplained),
        *budget_blocks(diagnosis.budget),
        verdict_block(diagnosis),
    ]


def verdict_block(diagnosis: Diagnosis) -> Verdict:
    """The verdict as a block in its colour."""
    return Verdict(capitalised(verdict(diagnosis)), VERDICT_COLOURS[diagnosis.verdict], label="Verdict")


def brief_presentation(diagnosis: Diagnosis, what_next: Sequence[str]) -> Presentation:
    """What a terminal shows by itself: errors, budget, verdict, error history, five candidates, and what to do next."""
    best = ranking(diagnosis.screenings[0], most=BRIEFLY_RANKED, likely=diagnosis.told_probabilities)
    return Presentation(
        f"Diagnosis of {diagnosis.calibration.dataset.name}",
        diagnosis_head(diagnosis),
        [
            Section(HISTORY, [replace(step_table(diagnosis.steps), caption="")], brief=True),
            Section(MISSING, [best], brief=True),
            Section(NEXT, [Bullets(what_next)], brief=True),
        ],
    )


def ranked_effects(diagnosis: Diagnosis) -> list[Block]:
    """Blocks on the evidence of each candidate effect at the first decision, and on untestable effects."""
    return [
        ranking(diagnosis.screenings[0], most=RANKED, likely=diagnosis.told_probabilities),
        *untestable_blocks(diagnosis.untestable),
    ]


def explanation(diagnosis: Diagnosis, poses: NextPoses | None) -> str:
    """The reasons and the verdict as plain text, a paragraph each, the verdict last."""
    why = [
        *(paragraph.words for paragraph in reasons(diagnosis, poses)),
        *intervention_sentences(diagnosis),
        *drive_sentences(diagnosis.calibration.dataset.robot),
        spans("Verdict: ", verdict(diagnosis)),
    ]
    return "\n\n".join(map(plain, why))


# ---- how the verdict was reached ------------------------------------------------------------------------------------


def reasons(diagnosis: Diagnosis, poses: NextPoses | None) -> list[Paragraph]:
    """Paragraphs on the reasons for the verdict: first fit, each effect, open questions, residual, noise."""
    words: list[Words] = []
    if diagnosis.data_problem is not None:
        wrong = numbers.capitalised(diagnosis.data_problem.warning)
        words.append(f"{wrong}. Signs, order, units, rows and tables come before any effect: none is named.")
    words.append(_first_fit(diagnosis.steps[0].calibration))
    for before, after in zip(diagnosis.steps, diagnosis.steps[1:], strict=False):
        if after.candidate is not None:
            words.append(effect_added(before, after, diagnosis.conclusion.standing(after.effect or "") or "open"))
    confirm = {c.name: c.family.description.confirm for c in diagnosis.candidates}
    words += [confounded(one, confirm) for one in diagnosis.confounded_sets]
    if poses is not None:
        if diagnosis.undecided is not None and poses.discrimination is not None:
            shown = poses_to_measure(poses.poses[:_SHOWN_POSES], diagnosis.calibration.dataset.robot.is_revolute)
            power = numbers.share(poses.discrimination.power)
            settle = f"{len(poses.poses)} planned poses settle it with a probability of {power}."
            words.append(f"Poses at which they differ most, joints in degrees: {shown}. {settle}")
        if poses.change is not None:
            words.append(statement(poses.change))
    if diagnosis.refused is not None:
        words.append(refusal(diagnosis.refused))
    words.append(residual_tests(diagnosis.residual_tests, diagnosis.calibration.sigma_mm))
    if diagnosis.noise is not None:
        words.append(noise_sentences(diagnosis))
    if diagnosis.learned is not None:
        words.append(_learned(diagnosis.learned))
    if likely := diagnosis.told_probabilities:
        words.append(probability_sentence(likely))
    return [Paragraph(sentence) for sentence in words]


def _first_fit(calibration: Calibration) -> str:
    """Sentence on the model that the diagnosis began with, and its error."""
    fit, dataset = calibration.fit, calibration.dataset
    train, test = calibration.after.train, calibration.after.test
    families = calibration.model.family_names
    of_lengths = dataset.points is not None and dataset.points.lengths is not None
    measured, rmse = ("measured length", "RMSE") if of_lengths else ("measured point", "3D RMSE")
    instrument = "scanner" if dataset.shows_faces else "instrument"
    words = (
        f"The five-parameter model{' with ' + numbers.listing(families) if families else ''} was fitted to "
        f"{numbers.count(train.points if train else 0, measured)} of {dataset.robot.name}, the {instrument}'s "
        f"place being unknown. The residual sigma is {numbers.length(calibration.sigma_mm)} per coordinate"
    )
    words += (
        f", {numbers.times(fit.reduced_chi)} the declared noise" if dataset.declares_noise else "; no noise is declared"
    )
    if train and test:
        words += (
            f"; the {rmse} is {numbers.length(train.rmse_mm)} at the training poses, {numbers.length(test.rmse_mm)} at "
            "the test poses"
        )
    words += "."
    if repeats := calibration.repeat_count:
        words += (
            f" The dataset's {repeats.repeats} points form {repeats.groups} repeat groups of equal joints and "
            "conditions, and each group counts once, by the mean of its repeats."
        )
    if shift := calibration.tool_shift:
        words += f" {numbers.capitalised(tool_shift_sentence(shift))}."
    words += "".join(f" {numbers.capitalised(one)}." for one in tool_mass_question(calibration))
    return words


def effect_added(before: FitStep, after: FitStep, standing: str) -> Words:
    """Text on an effect that a step added: evidence, change of the errors, fitted values, and warnings.

    standing: "claimed", "suspected" or "open" (it is fitted on behalf of a set).
    """
    candidate = after.candidate
    assert candidate is not None
    values = fitted_values(candidate, after.calibration)
    visible = visible_mm(candidate, before.calibration)
    size = "" if visible is None else f", {numbers.length(visible)} RMS at the tool"
    note = f" Note: {candidate.family.note}." if candidate.family.note else ""
    return spans(
        _STANDING[standing], with_key(candidate.name),
        f". It explains {numbers.share(candidate.explained_share)} of the squared residual{size} "
        f"(p = {numbers.probability(candidate.p_holm)})",
        _lead(before, after, standing), f". {_change_with_it(before.calibration, after.calibration)}",
        _values(values, after.calibration), _doubts(values), note,
    )  # fmt: skip


def _lead(before: FitStep, after: FitStep, standing: str) -> Words:
    """Phrase with the log Bayes factor of an added effect over the next candidate."""
    lead: Words = ()
    factor = after.log_bayes_factor
    if after.runner_up and factor is not None:
        found = f", is {factor:.0f} (more than {MIN_LOG_BAYES_FACTOR:g} is required)"
        if standing == "claimed" and factor <= MIN_LOG_BAYES_FACTOR:
            # Claimed with less, it has no rival: the next would explain something else, and is tried again after it.
            found = f", which would explain something else, is {factor:.0f}"
        lead = spans("; its log Bayes factor over the next, ", effect(after.runner_up), found)
    screening, candidate = before.screening, after.candidate
    # As the search does it: curves are dear to learn, and are learned only where they could say more.
    if (
        screening is None
        or candidate is None
        or not may_be_curves(screening.candidates[0], before.calibration, screening)
    ):
        return lead
    above = left_to_curves(screening, before.curves, candidate)
    if not above:
        return lead
    rank = "rank" if len(above) > 1 else "ranks"
    curved = f" {rank} above it, but curves of all joints explain clearly more"
    return spans(lead, "; ", effects(above), curved)


def _change_with_it(before: Calibration, after: Calibration) -> str:
    """Sentence on the change of the error between two fits, with a space behind it; "" where it is not known."""
    change = ErrorChange.between(before.after, after.after).words()
    return f"With it {change}. " if change else ""


def _values(values: Sequence[FittedValue], calibration: Calibration) -> str:
    if not values:
        return "None of its parameters is known to better than half its size by itself; together they are."
    more = len(values) - _SHOWN_VALUES
    listed_values = "; ".join(_value(value, calibration) for value in values[:_SHOWN_VALUES])
    return f"Fitted: {listed_values}{f'; and {more} more' if more > 0 else ''}."


def _value(value: FittedValue, calibration: Calibration) -> str:
    unit = value.parameter.unit
    means = "" if unit == "rad" else meaning(value.effect, value.parameter, value.value, calibration)
    return f"{value.name} = {numbers.with_sigma(value.value, value.sigma, unit)}{f' ({means})' if means else ''}"


def _doubts(values: Sequence[FittedValue]) -> str:
    """Sentence on the fitted value that exceeds its natural bound by most; "" where no value does."""
    beyond = [(abs(v.value) / v.bound.size, v, v.bound) for v in values if v.bound is not None]
    ratio, value, bound = max(beyond, key=lambda one: one[0], default=(0.0, None, None))
    if value is None or bound is None:
        return ""
    return (
        f" Implausible: {value.name} is {numbers.times(ratio)} the largest known value of such a cause "
        f"({bound.size:g} {bound.unit}; {bound.source}); another cause may stand behind the name."
    )


def confounded(found: ConfoundedSet, confirm: dict[str, str]) -> Words:
    """Text on an effect fitted on behalf of effects confounded with it, and the measurements that would discriminate.

    confirm: what to measure to see an effect alone, by its key.
    """
    sentences: list[Words] = []
    if found.equivalent:
        alike = (found.effect, *found.equivalent)
        behalf = "both" if len(alike) == 2 else "all of them"
        why = "are indistinguishable at these poses"
        if found.is_undecided:
            why = (
                f"could each be the cause, and none leads the others by a log Bayes factor of {MIN_LOG_BAYES_FACTOR:g}"
            )
        sentences.append(
            spans(
                listed(map(with_key, alike)), f" {why}; ", effect(found.effect),
                f" is fitted on behalf of {behalf}, and none is claimed.",
            )
        )  # fmt: skip
        if measures := "; ".join(f"for {key}, {confirm[key]}" for key in alike if confirm.get(key)):
            sentences.append(f"To tell them apart, measure: {measures}.")
    if found.untested:
        sentences.append(
            spans(
                "These data lack what would discriminate between ", with_key(found.effect), " and ",
                effects(found.untested),
                "; it is fitted on behalf of all of them, and none is claimed. To settle it, ", found.would_help, ".",
            )
        )  # fmt: skip
    return joined(sentences, " ")


def poses_to_measure(poses: Sequence[DiscriminatingPose], is_revolute: BoolArray) -> str:
    """Text with poses to measure, degrees (mm for prismatic joints), and the hypotheses' least difference at each.

    is_revolute  # (n,)
    """
    return "; ".join(
        f"({', '.join(f'{v:.0f}' for v in np.where(is_revolute, np.degrees(one.q), one.q))}): "
        f"{numbers.length(one.separation_mm)} apart"
        for one in poses
    )


def refusal(refused: Refusal) -> Words:
    """Text on an effect that explains the training poses but was refused, with the reason."""
    against = _REFUSALS[refused.why].format(refused.detail)
    return spans(capitalised(with_key(refused.effect)), f" explains the training poses well, but {against}")


def residual_tests(tests: ResidualTests, sigma_mm: float) -> Words:
    """Text on the residual of a fit of which `sigma_mm` is told: its size, the noise, and the results of its tests."""
    # The tests count the degrees of freedom in their own way: what is the same to a tenth is told as one number.
    is_told = math.isclose(sigma_mm, tests.residual_mm, rel_tol=_SAME)
    words: list[Words] = [
        f"The residual is {numbers.length(sigma_mm if is_told else tests.residual_mm)} per coordinate; the noise is "
        f"{numbers.length(tests.noise_mm)}, {_NOISE_SOURCES[tests.noise_from]}."
    ]
    if tests.masses_evidence > REPORTED_EVIDENCE:
        words.append(
            "A part of it follows from masses or centres of mass that differ from robot.toml (log evidence "
            f"{tests.masses_evidence:.0f}); it was allowed for before anything else was looked for. Better masses in "
            "robot.toml would remove it."
        )
    if tests.structured:
        words.append(_pattern(tests))
    elif tests.inputs:
        closest = tests.inputs[0]
        none = f"It does not depend systematically on any of {numbers.count(len(tests.inputs), 'input')} (closest: "
        words.append(spans(none, input_name(closest.input), f", p = {numbers.probability(closest.p_value)})."))
    if tests.too_large:
        words.append("It is more than noise.")
    if tests.fault is not None:
        words.append(spans("It looks as if ", fault(tests.fault), f" (log evidence {tests.fault.log_evidence:.0f})."))
    if tests.outlier_poses:
        words.append(outliers_sentence(tests.outlier_poses))
    return joined(words, " ")


def outliers_sentence(poses: Sequence[str]) -> Words:
    """Sentence that names the poses whose residuals stand out of all others."""
    subject = "One pose stands" if len(poses) == 1 else "Single poses stand"
    return spans(f"{subject} out: ", listed(map(pose, poses)), ".")


def _pattern(tests: ResidualTests) -> Words:
    first = tests.inputs[0]
    name = input_name(first.input)
    axis = f"{first.channel.name} of the instrument's frame"
    where = "along that axis" if name == axis else f"along {axis}"
    if first.channel.axis == ALONG_LENGTH:
        where = "in the measured lengths"
    if first.channel.joint is not None:
        where = f"in the motion of {first.channel.name}"
    over = spans(" over ", name) if len(tests.structured) > 1 else ()
    return spans(
        "It depends systematically on ", listed(map(input_name, tests.structured)),
        f" (p = {numbers.probability(first.p_value)}), most clearly {where}", *over, ": it is not noise.",
    )  # fmt: skip


def _learned(learned: LearnedModel) -> Words:
    changed = _change_with_it(learned.before, learned.after)
    spaced = _SIGN.sub(r" \1 ", learned.formula or "")
    formula = f"; in short {spaced}" if spaced else ""
    told = law_sentences(law_readings(learned.after), learned.laws)
    if learned.laws is not None:
        return spans(
            laws(learned.joints, learned.inputs, learned.laws), f" {changed}It is in the model as "
            f"{LEARNED}{formula}. It names the form of the cause, not the part. ", " ".join(told),
        )  # fmt: skip
    subject = "They were" if len(learned.joints) > 1 else "It was"
    pairs = zip(curve_readings(learned.after), members_of_one_input(learned.after), strict=True)
    shapes = "; ".join(reading_phrase(one) for one, member in pairs if not is_law(member))
    read = f" {numbers.capitalised(shapes)}." if shapes else ""
    return spans(
        curves(learned.joints, learned.inputs, learned.log_evidence),
        f" {subject} learned as {LEARNED}{formula}. {changed}No cause is named by it.{read}",
        "".join(f" {one}" for one in [*told, *coupling_sentences(coupling_readings(learned.after))]),
    )


# ---- the keys of diagnose --json ------------------------------------------------------------------------------------


@document.register
def _document(diagnosis: Diagnosis) -> dict[str, Any]:
    return diagnosis_document(diagnosis, next_poses(diagnosis))


def diagnosis_document(diagnosis: Diagnosis, poses: NextPoses | None) -> dict[str, Any]:
    """Document that `diagnose --json` prints, with the next poses to measure where they were chosen already."""
    last, held_out, refused = diagnosis.calibration, diagnosis.held_out, diagnosis.refused
    likely = diagnosis.told_probabilities
    return to_dict({
        "dataset": last.dataset.name,
        "stands": stands_document(last),
        "left_out": last.fitted_dataset.left_out,
        **found_tool_document(last),
        "worse_than_nominal": worsening_sentence(last) or None,
        "table_doubts": doubtful_entries(last),
        "leading_entry": leading_entry(last),
        **keys_of(
            diagnosis, "verdict", "missing", "suspected", "ambiguous_set", "far_test_poses", "steps", "learned",
            "data_problem", "instrument_moved", "swapped",
        ),
        "open_sets": diagnosis.confounded_sets,
        "refused": refused and refused.effect,
        "promise": held_out and {**document(held_out), "kept": not held_out.is_broken},
        **budget_document(diagnosis.budget),
        **proven_document(diagnosis),
        **probability_document(likely),
        "candidates": [to_dict(c) | {"probability": likely and likely.of(c.name)} for c in diagnosis.candidates],
        "untestable": [{"effect": u.name, "why": u.why, "would_help": u.would_help} for u in diagnosis.untestable],
        "leftover": diagnosis.residual_tests,
        "measure_next": () if poses is None else poses.poses,
        "prove_next": None if poses is None else poses.change,
        "explanation": explanation(diagnosis, poses),
        "outside": last.outside,
        "noise": noise_document(diagnosis),
        **signals_document(last.dataset.robot),
        **promise_document(promise(last), last.dataset.poses),
    })  # fmt: skip


@document.register
def _step_document(step: FitStep) -> dict[str, Any]:
    return {
        **keys_of(step, "effect"),
        **keys_of(step.calibration.after, "train_rmse_mm", "test_rmse_mm"),
        **keys_of(step.calibration, "sigma_mm"),
        "p_value": step.candidate and step.candidate.p_value,
        "log_evidence_margin": step.log_bayes_factor,
    }


@document.register
def _candidate_document(candidate: Candidate) -> dict[str, Any]:
    return {
        "effect": candidate.name,
        **keys_of(candidate, "p_value", "p_holm", "log_evidence", "explained_share", "cv_rmse_mm", "overlaps"),
        "parameters": candidate.values,
        "note": candidate.family.note or None,
    }


@document.register
def _input_test_document(test: InputTest) -> dict[str, Any]:
    return {"input": test.input, "p_value": test.p_value, "where": test.channel.name}


@document.register
def _learned_document(learned: LearnedModel) -> dict[str, Any]:
    return {
        **keys_of(learned, "joints", "inputs", "formula", "share"),
        **keys_of(learned.after.after, "train_rmse_mm", "test_rmse_mm"),
        "readings": readings_document(curve_readings(learned.after)),
        "couplings": coupling_readings(learned.after),
        "laws": laws_document(law_readings(learned.after), learned.laws),
    }


@document.register
def _fault_document(found: JointFault) -> dict[str, Any]:
    return {**own_fields(found), "joint": found.joint + 1, "words": plain(fault(found))}
