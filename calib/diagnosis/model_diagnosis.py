"""The diagnosis of a model at which a search stopped: tests of its residual, confounded effects, learned curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from calib.calibration.held_out import held_out_test
from calib.calibration.promise import learned_discrepancy
from calib.calibration.result import Calibration
from calib.diagnosis.decision_rules import equivalent_to, led_rivals
from calib.diagnosis.effect_selection import FitStep, SelectedEffect, evidence_on_the_way
from calib.diagnosis.moves import PartlyConfounded, SearchEnd, next_effect, straight_steps
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace, step_after, without_one
from calib.diagnosis.verdict import ConfoundedSet, HangingEffect, LearnedModel
from calib.screening.candidates import Candidate, Screening, screening_of
from calib.screening.curves.law_search import MIN_FIRST_GAIN, FoundLaws
from calib.screening.curves.smooth_joint_error import LEARNED, SmoothJointError, formula_text, is_law
from calib.screening.left_out import far_test_poses
from calib.screening.leverage import pose_that_carries
from calib.screening.noise_likelihood import scatter_of_repeats
from calib.screening.noise_search import AddedEffect, EstimatedNoise, first_unproven
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import ResidualTests, run_residual_tests
from calib.screening.smooth_motions import JointFault, smooth_motion


def diagnosis_of_model(
    space: SearchSpace, steps: Sequence[FitStep], stop: SearchEnd, tests: ResidualTests | None = None
) -> Diagnosis:
    """Diagnosis of the last step's model, to which the search adds no further effect.

    Args:
        space: settings of all fits.
        steps: models that led to it, in whatever order; the diagnosis has the straight way.
        stop: why no effect is to be added.
        tests: of the last fit's residual, where they were done already.
    """
    last = steps[-1]
    space = space.without(last.left_out)
    if any(effect.name == LEARNED for effect in last.selected):
        return _with_curves_inside(space, steps)
    if tests is None:
        tests = run_residual_tests(last.calibration.dataset, project_residual(last.calibration))
    left_out = last.calibration.outliers  # by robust fits
    if left_out:
        tests = replace(tests, outlier_poses=tuple(dict.fromkeys([*left_out, *tests.outlier_poses])))
    straight = straight_steps(space, steps)
    if tests.fault is None and len(straight) > 1:
        tests = replace(tests, fault=_curve_in_their_place(straight))
    diagnosis = Diagnosis(
        steps=straight,
        all_tests=tests,
        implausible=stop.implausible,
        confounded_sets=confounded_sets(space, straight, stop.ties),
        refused=stop.refused,
        left_to_curves=stop.left_to_curves,
        held_out=held_out_test(
            last.calibration, tests.noise_mm, tests.noise_from, learned_discrepancy(last.calibration)
        ),
        far_test_poses=far_test_poses(last.calibration),
        noise=_noise_taken(last.calibration),
    )
    if stop.implausible:
        return diagnosis
    # Each effect is weighed given all others: one that was added first may have had to stand in for later ones, and a
    # drift of the instrument for them as well.
    weighed = [
        (candidate, without.screening)
        for k, effect in enumerate(last.selected)
        if (without := _before(space, diagnosis, k)).screening is not None
        and (candidate := without.candidate_named(effect.name)) is not None
    ]
    return replace(
        diagnosis, no_more_than_drift=_no_more_than_drift(diagnosis, weighed), hanging=_first_hanging(weighed)
    )


def _curve_in_their_place(steps: Sequence[FitStep]) -> JointFault | None:
    """Smooth motion of one joint over one angle that clearly leads all effects added in its place; None for none.

    Waves and tilts follow a good part of whatever joint errs with an angle; the right ones leave a curve no lead.
    """
    way = evidence_on_the_way(steps)
    for told, step in zip(way[:-1], steps, strict=False):
        assert step.screening is not None
        found = smooth_motion(step.screening.projected, of_one_angle=True)
        if found is not None and told + found.log_evidence > way[-1] + MIN_FIRST_GAIN:
            return found
    return None


_Weighed = Sequence[tuple[Candidate, Screening]]
"""Effects of a model as candidates, each with the screening of the model without it."""


def _no_more_than_drift(diagnosis: Diagnosis, weighed: _Weighed) -> AddedEffect | None:
    """First effect of the model that an instrument drift explains as well; None where there is none."""
    noise = diagnosis.calibration.options.noise
    if noise is not None and noise.wander is not None:
        return None  # the drift is part of the noise already
    added = [AddedEffect(one.name, one.log_evidence, screening.projected) for one, screening in weighed]
    return first_unproven(added, diagnosis.all_tests.outlier_poses)


def _first_hanging(weighed: _Weighed) -> HangingEffect | None:
    """First effect of the model that a single pose carries; None where there is none."""
    for candidate, screening in weighed:
        if candidate.members and candidate.log_evidence > 0.0:
            pose = pose_that_carries(candidate, led_rivals(candidate, screening), screening.projected)
            if pose is not None:
                return HangingEffect(candidate.name, pose)
    return None


def _before(space: SearchSpace, diagnosis: Diagnosis, k: int) -> FitStep:
    """The last step's model without its effect number k; of the effect that was added last, the step before."""
    last = diagnosis.steps[-1]
    if k == len(last.selected) - 1:
        return diagnosis.steps[-2]
    return without_one(space, last, k, everything=False)


def _noise_taken(calibration: Calibration) -> EstimatedNoise | None:
    """Noise shape that a fit used in place of the declared noise; None where it used the declared noise."""
    shape = calibration.options.noise
    if shape is None:
        return None
    return EstimatedNoise(shape, from_repeats=scatter_of_repeats(calibration.dataset) is not None)


# ---- confounded effects ---------------------------------------------------------------------------------------------


def confounded_sets(
    space: SearchSpace, steps: Sequence[FitStep], ties: Sequence[PartlyConfounded] = ()
) -> tuple[ConfoundedSet, ...]:
    """Sets of effects that the data cannot distinguish, each with one effect that is in the last model.

    Equivalent effects explain the same at these poses, so that only the prior would decide between them. Effects that
    the data lack the means to test (effects of load without masses) may be the cause as well. One of the set stands in
    the model, so that the error falls and further effects are found beside it.

    Args:
        space: settings of all fits.
        steps: from the link errors to the model, effect by effect, each with its screening.
        ties: effects of the model of which others explain the part on each joint as well.
    """
    last = steps[-1]
    out: list[ConfoundedSet] = []
    for before, after in pairwise(steps):
        name = after.effect
        family = None if name is None else space.family(name)
        if name is None or family is None or any(name in one.names for one in out):
            continue
        equivalent = _equivalent_in_model(space, last, name, equivalent_to(name, before.screening))
        tied = [other for tie in ties if tie.effect == name for other in tie.others]
        equivalent = tuple(dict.fromkeys([*equivalent, *tied]))
        equivalent = after.on_behalf_of or equivalent
        untested = [f for f in space.families if f.name in family.confounded_with and not f.never_testable]
        if equivalent or untested:
            would_help = next((f.would_help for f in untested if f.would_help), "")
            names = tuple(f.name for f in untested)
            out.append(ConfoundedSet(name, equivalent, names, would_help, bool(after.on_behalf_of)))
    return tuple(out)


def _equivalent_in_model(space: SearchSpace, last: FitStep, name: str, equivalent: tuple[str, ...]) -> tuple[str, ...]:
    """Names of effects equivalent to one effect of the model, given the model's other effects.

    Those found when it was added may have stood in for effects that were added later.
    """
    others: list[SelectedEffect] = [effect for effect in last.selected if effect.name != name]
    if not equivalent or last.selected[-1].name == name or not others:
        return equivalent
    names = {name, *equivalent} - {effect.name for effect in others}
    families = [family for family in space.families if family.name in names]
    return equivalent_to(name, screening_of(space.fit(others, last.calibration), families))


# ---- learned curves -------------------------------------------------------------------------------------------------


def with_learned(
    diagnosis: Diagnosis, step: FitStep, members: Sequence[SmoothJointError], laws: FoundLaws | None = None
) -> Diagnosis:
    """A diagnosis extended by a step that adds learned curves, or laws, of which the search is given then."""
    before, after = diagnosis.calibration, step.calibration
    assert before.after.train is not None
    assert after.after.train is not None
    values = dict(zip((p.name for p in after.fit.parameters), after.fit.x.tolist(), strict=True))
    learned = LearnedModel(
        members=tuple(members),
        formula=formula_text(tuple(members), values),
        share=1.0 - (after.after.train.rmse_mm / before.after.train.rmse_mm) ** 2,
        before=before,
        after=after,
        log_evidence=step.log_bayes_factor,
        laws=laws,
    )
    # Effects that are not in the model are judged by the residual before the curves took it away.
    step = replace(step, screening=diagnosis.steps[-1].screening)
    return replace(diagnosis, steps=(*diagnosis.steps, step), learned=learned)


def _with_curves_inside(space: SearchSpace, steps: Sequence[FitStep]) -> Diagnosis:
    """Diagnosis of a model that has learned curves: of the model without them, plus the step that adds them."""
    last = steps[-1]
    names = tuple(effect for effect in last.selected if effect.name != LEARNED)
    curves = next(effect for effect in last.selected if effect.name == LEARNED)
    alone = next((step for step in reversed(steps) if _same(step, names, last)), None)
    if alone is None:
        alone = FitStep("", names, space.fit(names, None), left_out=last.left_out)
    others = [step for step in steps if step is not last and step is not alone]
    alone = space.ranked(alone)
    stop = next_effect(space, alone)
    diagnosis = diagnosis_of_model(space, [*others, alone], stop if isinstance(stop, SearchEnd) else SearchEnd())
    before = diagnosis.steps[-1]
    selected = (*before.selected, curves)
    step = step_after(before, LEARNED, selected, last.calibration, log_bayes_factor=last.log_bayes_factor)
    members = [m for m in curves.members if isinstance(m, SmoothJointError)]
    found = before.laws if all(is_law(m) for m in members) else None
    searched = found if found is not None and set(found.members) == set(members) else None
    return with_learned(diagnosis, step, members, searched)


def _same(step: FitStep, selected: Sequence[object], last: FitStep) -> bool:
    """Whether a step has exactly the given effects and is fitted to the same poses as the last step."""
    without = step.calibration.dataset.left_out == last.calibration.dataset.left_out
    return step.selected == tuple(selected) and step.left_out == last.left_out and without
