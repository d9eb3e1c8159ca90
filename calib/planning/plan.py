"""A plan: the poses to measure, why each, and the held-out error that a fit has before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, IndexArray
from calib.blas_threads import one_blas_thread
from calib.dataset.dataset import Poses
from calib.effects.catalogue import family_of
from calib.effects.effect import Effect, Family, full_name
from calib.errors import CalibError
from calib.identifiability.structural import fewest_poses
from calib.kinematics.joint_range import random_poses
from calib.options import PLAN_REGIONS
from calib.planning.exchange import best_poses
from calib.planning.outcome import Outcome, PoseReason
from calib.planning.prediction import (
    Prediction,
    Region,
    enough_poses,
    predicted,
    predicted_once_placed,
)
from calib.planning.purpose import WATCH, ForCalibration, Purpose, Situation
from calib.planning.reasons import new_ids, parameter_reasons
from calib.planning.start import Start
from calib.presented import Presented
from calib.workcell.candidates import candidate_poses
from calib.workcell.order import clear_ways, order_poses

CANDIDATES = 800
RIGHT_EVERYWHERE = ForCalibration()
_REGION = 300  # poses of a region that is drawn
_FEWEST_TEST = 5  # test poses that make a region
_TYPED = 1e-3  # deg or mm
_THINNED = 3  # one of so many candidates for what lies beyond the plan
_FURTHER = 40  # poses beyond the plan, to see when more no longer pay


@dataclass(frozen=True)
class Plan(Presented):
    """The poses to measure, in the order of measuring, and what they are good for."""

    start: Start
    purpose: Purpose
    poses: Poses
    reasons: tuple[PoseReason, ...]  # why each pose was chosen
    worth: tuple[int, ...]  # 1 is the pose that tells most, by pose
    region: str  # where the error is predicted, in words
    now: Prediction
    then: Prediction
    curve_mm: Array  # (n + 1,) the predicted error by the number of new poses, from none to beyond the plan
    enough: int | None  # new poses from which five more lower it by less than 5 %; None: not within the curve
    power: float | None  # probability that confounded effects are told apart; None where none are to be
    model: tuple[str, ...]  # families beside the link errors
    outcome: Outcome | None  # what the plan does for its purpose, beside the predicted error
    least: int | None  # poses that a fit takes, where these are a first set of fewer
    blocked: tuple[tuple[str, str], ...]  # poses between which the straight way in joint space is blocked

    def _brief(self) -> str:
        error = f"predicted RMSE {self.now.geometry_mm:.3g} -> {self.then.geometry_mm:.3g} mm"
        return f"{self.start.dataset.name}: {len(self.poses)} poses for {self.purpose.name}, {error}"


@one_blas_thread()
def plan_poses(
    start: Start,
    count: int,
    *,
    purpose: Purpose = RIGHT_EVERYWHERE,
    region: str = "auto",
    user_effects: Sequence[Family] = (),
    candidates: int = CANDIDATES,
    seed: int = 0,
) -> Plan:
    """Choose `count` poses to measure.

    Args:
        start: what is known already.
        purpose: what the poses are for.
        region: where the fit is to be right: the test poses ("test"), all that can be measured ("measurable"), the
            joints' whole range ("all"); "auto" takes the test poses where there are at least five.
        user_effects: families of the user's own that the purpose may name.
        candidates: how many poses to choose from.
        seed: of the candidates.

    Raises:
        CalibError: too few poses can be measured, or an effect that cannot be planned for.
    """
    if count < 1:
        raise CalibError(f"found {count} poses to plan; ask for 1 or more")
    if region not in PLAN_REGIONS:
        raise CalibError(f"no region {region!r}; there are {', '.join(PLAN_REGIONS)}")
    rng = np.random.default_rng(seed)
    candidates = max(candidates, 2 * count)
    q = candidate_poses(start.cell, candidates + _REGION, rng=rng)  # the last of which are the region's
    offered = purpose.prepared(start, start.poses_at(q[:candidates]))
    unknowns = start.unknowns(_members(start, offered, purpose.effects, user_effects))
    wanted_at = _region(start, start.poses_at(q[candidates:]), region, rng)
    situation = Situation(start, unknowns, offered, unknowns.rows(offered), Region.of(*wanted_at, unknowns))
    chosen = purpose.choose(situation, count)
    curve_mm = _curve(situation, chosen)
    none = np.zeros(0, dtype=np.int64)
    placed_anew = start.measured is None or start.setup not in start.measured.setup
    if placed_anew:
        now = predicted_once_placed(situation.region, unknowns, unknowns.degrees_of_freedom, rng)
        curve_mm[0] = now.geometry_mm
    else:
        now = predicted(situation.region, situation.information(none), unknowns.degrees_of_freedom, rng)
    then = predicted(situation.region, situation.information(chosen), unknowns.degrees_of_freedom, rng)
    reasons = purpose.reasons(situation, chosen) or parameter_reasons(situation, chosen)
    order = _order(situation, chosen)
    planned = _to_measure(situation, chosen[order], a_set=purpose.name == WATCH)
    return Plan(
        start=start,
        purpose=purpose,
        poses=planned,
        reasons=tuple(reasons[k] for k in order),
        worth=tuple(int(k) + 1 for k in order),
        region=situation.region.words,
        now=now,
        then=then,
        curve_mm=curve_mm,
        enough=enough_poses(curve_mm, first=1 if placed_anew else 0),
        power=purpose.power(situation, chosen),
        model=unknowns.model.family_names,
        outcome=purpose.outcome(situation, chosen),
        least=_more_than(start, count),
        blocked=_blocked_ways(start, planned),
    )


def _more_than(start: Start, count: int) -> int | None:
    """Number of poses that a fit of the link errors takes, where a first set of `count` has fewer."""
    least = fewest_poses(start.dataset.robot)
    return least if start.measured is None and count < least else None


def _blocked_ways(start: Start, planned: Poses) -> tuple[tuple[str, str], ...]:
    """Successive poses between which moving all joints at once leads through an obstacle, whatever the order."""
    blocked = np.flatnonzero(~clear_ways(start.cell, planned.q))
    return tuple((planned.ids[k], planned.ids[k + 1]) for k in blocked)


def _members(start: Start, offered: Poses, names: Sequence[str], user_effects: Sequence[Family]) -> tuple[Effect, ...]:
    """The members of these families for the unknowns, those that the fit has already apart.

    Raises CalibError for a family that the planned poses cannot test either, or that is at a few of many places.
    """
    if not names:
        return ()
    fit = start.unknowns()
    in_fit = set(fit.parameter_names)
    # In their own order, not as of a later time, and with points where they should be: families ask for both.
    rows = replace(offered, order=np.zeros(0), came_from=np.zeros((0, 0)))
    planned = replace(start.dataset, poses=rows, points=fit.points(offered))
    members: list[Effect] = []
    for name in names:
        family = None if start.measured is None else family_of(start.dataset, name, user_effects)
        if family is None or family.why_not:
            family = family_of(planned, name, user_effects)
        if family.why_not:
            raise CalibError(f"effect {name} cannot be planned for: {family.why_not}; {family.would_help}")
        if family.sparse:
            raise CalibError(
                f"effect {name} is at few of {len(family.members)} places, which no pose can be planned for; "
                "add it to the fit with --add"
            )
        members += [m for m in family.members if not in_fit & {full_name(m, p) for p in m.parameters}]
    return tuple(members)


def _region(start: Start, others: Poses, region: str, rng: np.random.Generator) -> tuple[str, Poses]:
    """In words, and its poses; `others` are some that can be measured."""
    measured = start.measured
    if measured is not None and region in ("auto", "test"):
        placed = np.isin(measured.setup, list(start.unknowns().scanner_T_base))
        test = np.flatnonzero(measured.is_test & placed)
        if len(test) >= (_FEWEST_TEST if region == "auto" else 1):
            return f"the {len(test)} test poses", measured.select(test)
    if region == "test":
        raise CalibError(f"dataset {start.dataset.name}: no test poses to be right at; take another region")
    if region == "all":
        robot = start.dataset.robot
        return "the joints' whole range", start.poses_at(random_poses(robot, _REGION, rng=rng))
    return "the poses that can be measured", others


def _curve(situation: Situation, chosen: IndexArray) -> Array:
    """(n + 1,) the region's predicted error with the first of the chosen, in order of worth, then with more."""
    region = situation.right_at_region
    logs = [region.log_value(situation.information(chosen[:k])) for k in range(len(chosen) + 1)]
    some = np.arange(0, len(situation.rows), _THINNED)
    further = min(_FURTHER, len(some) - len(chosen))
    beyond = replace(region, rows=region.rows[some], known=situation.information(chosen))
    more = best_poses([beyond], further, exclude=np.isin(some, chosen), exchange=False)
    return np.exp(0.5 * np.array([*logs, *more.greedy_log_values]))


def _order(situation: Situation, chosen: IndexArray) -> IndexArray:
    """The order of measuring, as indices into the chosen: short ways; each temperature and payload in one go."""
    start, poses = situation.start, situation.candidates.select(chosen)
    at = start.measured.q[np.argmax(start.measured.order)] if start.measured is not None else None
    kept = [values for values in (poses.temperature_c, poses.payload_kg) if values is not None]
    groups = np.unique(np.column_stack([np.zeros(len(chosen)), *kept]), axis=0, return_inverse=True)[1].ravel()
    out: list[int] = []
    for group in range(groups.max() + 1):
        rows = np.flatnonzero(groups == group)
        out += rows[order_poses(start.cell, poses.q[rows], at)].tolist()
        at = poses.q[out[-1]]
    return np.array(out, dtype=np.int64)


def _to_measure(situation: Situation, rows: IndexArray, *, a_set: bool) -> Poses:
    """The chosen candidates under names of their own, joints to 0.001 deg or mm as a person would type them.

    The first is the reference where they are a dataset by themselves: from scratch, or `a_set`, as check poses are.
    """
    measured = situation.start.measured
    ids = new_ids(len(rows), () if measured is None else measured.ids)
    role = np.full(len(rows), "train", dtype="<U9")
    if measured is None or a_set:
        role[0] = "reference"
    poses = situation.candidates.select(rows)
    step = np.where(situation.start.dataset.robot.is_revolute, np.radians(_TYPED), _TYPED)
    poses = replace(poses, q=step * np.round(poses.q / step))
    temperature_c = poses.temperature_c
    if temperature_c is not None and not np.ptp(temperature_c) > 0.0:
        temperature_c = None  # of no matter for these; what is measured then counts, as for the time
    poses = replace(poses, temperature_c=temperature_c, time_s=None)
    return replace(poses, ids=ids, role=role, scan_names=tuple(f"{pose_id}.ply" for pose_id in ids))
