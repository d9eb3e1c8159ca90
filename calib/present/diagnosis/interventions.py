"""Presentation of what paired poses prove: a section of a diagnosis, its sentences, and the key of `--json`."""

from __future__ import annotations

from typing import Any

from calib.diagnosis.contradictions import Contradiction
from calib.diagnosis.result import Diagnosis
from calib.intervention.joint_fit import JointFit
from calib.intervention.pairs import APPROACH, PAYLOAD, SPEED
from calib.intervention.proof import MIN_LEAD, Intervention, Proof, ProvenValue
from calib.present.effects import title, with_key
from calib.present.fit.errors import HELD_OUT, ErrorChange
from calib.present.results import keys_of
from calib.rendering import numbers
from calib.rendering.blocks import Block, FigurePlace, Paragraph, Section, Words, effect, effects, joint, listed, spans

PROVEN = "Proven by changing one thing"
_VALUE = ("effect", "joint", "parameter", "value", "sigma", "unit")
_TAKEN_AWAY = "the motion of the instrument and the shift of the tool between the runs are taken away."


def intervention_sections(diagnosis: Diagnosis) -> list[Section]:
    """Section on what poses measured again under another condition prove; [] where there are none."""
    sentences: list[Block] = [Paragraph(words) for words in intervention_sentences(diagnosis)]
    figures = [
        FigurePlace("moved_by_change", (one,), f"Differences by {_change(one)}; {_TAKEN_AWAY}", height_px=280)
        for one in diagnosis.interventions
        if one.proofs
    ]
    return [Section(PROVEN, [*sentences, *figures], brief=True)] if sentences else []


def intervention_sentences(diagnosis: Diagnosis) -> list[Words]:
    """Sentences on each condition that was changed: what is proven, what stays open, and what the fit contradicts."""
    words: list[Words] = []
    for one in diagnosis.interventions:
        words += [_proven(one, proof) for proof in one.proofs]
        words += _not_proven(one)
    words += [_contradicted(one) for one in diagnosis.contradictions]
    return words if diagnosis.joint_fit is None else [*words, _together(diagnosis, diagnosis.joint_fit)]


def _proven(intervention: Intervention, proof: Proof) -> Words:
    pairs = numbers.count(intervention.held_out, "pair")
    confirmed = f" It predicts {pairs} of {HELD_OUT} no worse." if intervention.held_out else ""
    size = numbers.with_sigma(proof.value, proof.sigma, proof.unit)
    what = _together_alike(proof) or spans(
        with_key(proof.effect), _of_joint(proof.joint), f", {proof.parameter} = {size}. "
    )
    return spans(
        f"Proven by {numbers.count(proof.pairs, 'pair')}, {_change(intervention)}: ", what,
        "Without it nothing in the catalogue explains the differences, in which all geometry cancels (log evidence "
        f"lower by {proof.lead:.1f}; {MIN_LEAD:g} is required).{confirmed}",
    )  # fmt: skip


def _together_alike(proof: Proof) -> Words:
    """Sentences on members that these poses cannot tell apart: the place on the arm, and by how much it yields."""
    if not proof.alike:
        return ()
    along = sorted(proof.alike, key=_along_arm)
    first, last = (
        f"{'link' if is_link else 'joint'} {joint}" if joint else "the base"
        for joint, is_link in map(_along_arm, (along[0], along[-1]))
    )
    low, high = min(one.value - one.sigma for one in along), max(one.value + one.sigma for one in along)
    causes = dict.fromkeys((one.effect, one.joint) for one in along)
    names = [spans(effect(name, title(name)), _of_joint(number)) for name, number in causes]
    return spans(
        f"the place between {first} and {last} yields, by {low:.1e} to {high:.1e} {proof.unit}; these poses cannot ",
        "tell ", listed(names), " apart. ",
    )  # fmt: skip


def _along_arm(value: ProvenValue) -> tuple[int, bool]:
    """Place of a member on the arm: its joint's number, and whether it is the link behind that joint."""
    return value.joint or 0, value.effect.startswith("link_")


def _not_proven(intervention: Intervention) -> list[Words]:
    pairs = f"{numbers.count(intervention.pairs, 'pair')}, {_change(intervention)}, "
    causes = [spans(effect(one.effect, title(one.effect)), _of_joint(one.joint)) for one in intervention.open_causes]
    if len(causes) == 1:
        return [spans(f"{pairs}speak for ", *causes, ", but not clearly enough to prove it.")]
    if causes:
        return [spans(f"{pairs}do not settle what moves the arm: ", listed(causes, "or"), ".")]
    if intervention.proofs:
        return []
    return [f"{pairs}show no effect beyond noise, a moved instrument and a moved tool."]


def _contradicted(contradiction: Contradiction) -> Words:
    proof = contradiction.proof
    finds = spans("names ", effects(contradiction.instead), " instead")
    if contradiction.fitted is not None:
        finds = (f"has {numbers.with_sigma(*contradiction.fitted, proof.unit)}",)
    return spans(
        "The fit of all poses contradicts the pairs on ", effect(proof.effect), _of_joint(proof.joint), ": it ", finds,
        ". Believe the pairs, in which all geometry cancels.",
    )  # fmt: skip


def _together(diagnosis: Diagnosis, joint_fit: JointFit) -> Words:
    """Sentence on the fit of single poses and differences with one set of parameters."""
    values = [
        spans(effect(name), _of_joint(number), f" {parameter} = {numbers.with_sigma(value, sigma, unit)}")
        for name, number, parameter, value, sigma, unit in _joint_values(diagnosis, joint_fit)
    ]
    weight = numbers.share(joint_fit.weight_of_single)
    of_weight = f", a single pose with {weight} of a difference's weight" if joint_fit.misfit else ""
    changed = [
        f" {word} {numbers.listing(names)}"
        for word, names in (("with", joint_fit.added), ("without", joint_fit.dropped))
        if names
    ]
    change = ErrorChange.between(diagnosis.calibration.after, joint_fit.calibration.after)
    return spans(
        f"Single poses and differences fitted together{of_weight}:", *changed, " " if not changed else ": ",
        listed(values), f"; {change.words()}.",
    )  # fmt: skip


def _joint_values(diagnosis: Diagnosis, joint_fit: JointFit) -> list[tuple[str, int | None, str, float, float, str]]:
    """Effect, joint, parameter, value, sigma and unit of each proven value in the fit of all together."""
    fit = joint_fit.calibration.fit
    found = fit.by_name
    return [
        (proof.effect, proof.joint, proof.parameter, *found[proof.full_name], proof.unit)
        for proof in {one.full_name: one for one in diagnosis.proven}.values()
        if proof.full_name in found
    ]


def _joint_document(diagnosis: Diagnosis) -> dict[str, Any] | None:
    found = diagnosis.joint_fit
    if found is None:
        return None
    roles = ("train_rmse_mm", "test_rmse_mm")
    return {
        **keys_of(found.calibration.after, *roles),
        **{f"alone_{key}": mm for key, mm in keys_of(diagnosis.calibration.after, *roles).items()},
        **keys_of(found, "weight_of_single", "added", "dropped"),
        "values": [dict(zip(_VALUE, row, strict=True)) for row in _joint_values(diagnosis, found)],
    }


def _change(intervention: Intervention) -> str:
    """Phrase on what was done between the poses of a pair: "hanging 2.5 kg on the flange"."""
    levels = [f"{level:.4g}" for level in intervention.levels]
    if intervention.conditions == (PAYLOAD,):
        hung = [level for level in levels if level != "0"] if intervention.levels[0] == 0.0 else levels
        return f"hanging {numbers.listing(hung)} kg on the flange"
    if intervention.conditions == (APPROACH,):
        return "coming to the pose from the other side"
    if intervention.conditions == (SPEED,):
        return f"at speeds from {levels[0]} to {levels[-1]}"
    if levels:
        return f"{intervention.conditions[0]} from {levels[0]} to {levels[-1]}"
    return f"changing {numbers.listing(intervention.conditions)} together"


# ---- words and documents --------------------------------------------------------------------------------------------


def _of_joint(number: int | None) -> Words:
    return () if number is None else spans(" of ", joint(number, f"joint {number}"))


def proven_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """JSON keys on what paired poses prove, and on the fit of them and single poses together."""
    return {
        "joint_fit": _joint_document(diagnosis),
        "proven": [
            keys_of(proof, *_VALUE, "pairs", "condition")
            | ({"set": [keys_of(one, *_VALUE) for one in proof.alike]} if proof.alike else {})
            for proof in diagnosis.proven
        ],
    }
