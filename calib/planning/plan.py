"""Plans: the poses to measure, the reason for each, and the predicted error of a fit before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray, Vector
from calib.blas_threads import one_blas_thread
from calib.dataset.dataset import Poses
from calib.dataset.files.poses_csv import poses_frame
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import family_of
from calib.effects.effect import Effect, Family, full_name
from calib.errors import CalibError
from calib.identifiability.structural import fewest_poses
from calib.kinematics.joint_range import random_poses
from calib.lazy_modules import pd
from calib.options import PLAN_REGIONS
from calib.planning.criterion import (
    DesignCriterion,
    DesignProblem,
    ForCalibration,
    ForEffects,
    Outcome,
    PlanTask,
    PoseReason,
)
from calib.planning.exchange import best_poses
from calib.planning.prediction import Prediction, Region, enough_poses, predicted, predicted_once_placed
from calib.planning.purpose import PlanPurpose, purposes
from calib.planning.start import Start
from calib.planning.ways import JointPath, ways_to
from calib.plugins import load
from calib.presented import Presented
from calib.statistics import group_numbers
from calib.workcell.candidates import candidate_poses
from calib.workcell.order import clear_ways, order_poses

FIRST_SET = 20  # poses to plan for a robot that was never measured, where no number is given
CANDIDATES = 800
LEAST_ERROR = ForCalibration()
_REGION = 300  # poses of a region that is drawn
_FEWEST_TEST = 5  # test poses that make a region
_FEWEST_IN_BOX, _BOX_TRIES = 40, 5  # poses of a box, for which the drawn poses are doubled and more as often
_TYPED = 1e-3  # deg or mm to which joints are rounded
_THINNED = 3  # one candidate of so many is considered for the curve beyond the plan
_BEYOND = 40  # poses beyond the plan, to see when more no longer pay


@dataclass(frozen=True)
class BoxRegion:
    """Region of the work space in which the tool point is to be right: a box along the axes of the base frame."""

    min_mm: Vector
    max_mm: Vector

    @property
    def name(self) -> str:
        """The box in words."""
        sides = zip("xyz", self.min_mm, self.max_mm, strict=True)
        return "the box " + ", ".join(f"{axis} {low:g} to {high:g}" for axis, low, high in sides) + " mm"

    def contains(self, points_mm: Array) -> BoolArray:
        """Mask (N,): whether points (N, 3), mm in the base frame, are in the box."""
        return np.all((points_mm >= self.min_mm) & (points_mm <= self.max_mm), axis=1)


@dataclass(frozen=True)
class Plan(Presented):
    """Poses to measure, in the order of measuring, with the errors predicted before and after."""

    start: Start
    criterion: DesignCriterion
    poses: Poses
    reasons: tuple[PoseReason, ...]  # why each pose was chosen
    ranks: tuple[int, ...]  # rank of each pose, 1 for the most informative
    region: str  # name of the poses at which the error is predicted
    now: Prediction  # before any of the poses is measured
    then: Prediction  # with all of the poses measured
    curve_mm: Array  # (n + 1,) predicted error with 0, 1, 2, ... new poses, beyond those of the plan
    enough: int | None  # new poses from which five more lower the error by less than 5 %; None: not within the curve
    model: tuple[str, ...]  # families of effects in addition to the link errors
    outcome: Outcome | None  # achievement beyond the predicted error
    fewest_for_fit: int | None  # poses that a fit takes, where the plan is a first set of fewer
    blocked: tuple[tuple[str, str], ...]  # successive poses whose straight connection in joint space is blocked

    @cached_property
    def ways(self) -> tuple[JointPath, ...]:
        """The way to each pose from the one before, by via points where the straight one is blocked."""
        return ways_to(self.start.cell, self.poses)

    @property
    def power(self) -> float | None:
        """Probability that it is told which hypothesis is true; None for criteria without hypotheses."""
        return None if self.outcome is None else self.outcome.power

    def to_frame(self) -> pd.DataFrame:
        """Table of the poses in the order of measuring, with the columns of poses.csv, angles in degrees."""
        return poses_frame(self.poses, self.start.dataset.robot)

    def _brief(self) -> str:
        error = f"predicted RMSE {self.now.geometry_mm:.3g} -> {self.then.geometry_mm:.3g} mm"
        return f"{self.start.dataset.name}: {len(self.poses)} poses for {self.criterion.name}, {error}"


@one_blas_thread()
def plan_poses(
    start: Start,
    count: int,
    *,
    criterion: DesignCriterion = LEAST_ERROR,
    region: str | BoxRegion = "auto",
    user_effects: Sequence[Family] = (),
    candidates: int | Poses = CANDIDATES,
    seed: int = 0,
) -> Plan:
    """Plan of `count` poses chosen by a criterion, with the errors predicted before and after.

    Args:
        start: fit or robot that the plan goes on from.
        count: number of poses to choose.
        criterion: criterion that the poses are chosen by.
        region: poses at which the error is predicted: the test poses ("test"), all that can be measured ("measurable"),
            the joints' whole range ("all"), those whose tool point is in a box; "auto" takes the test poses where there
            are at least five.
        user_effects: families of the user's own that the criterion may name.
        candidates: number of poses to draw and choose from, or the poses themselves, which then keep names and joints.
        seed: seed of the candidates.

    Raises:
        CalibError: too few poses can be measured, or an effect that cannot be planned for.
    """
    if count < 1:
        raise CalibError(f"found {count} poses to plan; ask for 1 or more")
    if isinstance(region, str) and region not in PLAN_REGIONS:
        raise CalibError(f"no region {region!r}; there are {', '.join(PLAN_REGIONS)}, or a box")
    rng = np.random.default_rng(seed)
    given = None if isinstance(candidates, int) else candidates
    drawn = max(candidates, 2 * count) if isinstance(candidates, int) else 0
    q = candidate_poses(start.cell, drawn + _REGION, rng=rng)  # the last of which are the region's
    offered = criterion.prepared(start, start.poses_at(q[:drawn] if given is None else given.q))
    if given is not None:
        if count > len(given):
            raise CalibError(f"found {len(given)} candidates for {count} poses; ask for fewer poses")
        offered = replace(offered, ids=given.ids)
    unknowns = start.unknowns(_members(start, offered, criterion.effects, user_effects))
    named, poses_there = _region(start, start.poses_at(q[drawn:]), region, rng)
    region_at = Region.of(named, poses_there, unknowns, start.missed_mm2(poses_there))
    problem = DesignProblem(start, unknowns, offered, unknowns.rows(offered), region_at)
    chosen = criterion.choose(problem, count)
    curve_mm = _curve(problem, chosen)
    none = np.zeros(0, dtype=np.int64)
    if start.measured is None:
        now = predicted_once_placed(problem.region, unknowns, unknowns.noise_dof, rng)
        curve_mm[0] = now.geometry_mm
    else:
        now = predicted(problem.region, problem.information(none), unknowns.noise_dof, rng)
    then = predicted(problem.region, problem.information(chosen), unknowns.noise_dof, rng)
    reasons = criterion.reasons(problem, chosen)
    order = _order(problem, chosen)
    planned = _to_measure(problem, chosen[order], criterion)
    if given is not None:
        kept = given.select(chosen[order])
        planned = replace(planned, q=kept.q, ids=kept.ids, scan_names=tuple(f"{pose_id}.ply" for pose_id in kept.ids))
    return Plan(
        start=start,
        criterion=criterion,
        poses=planned,
        reasons=tuple(reasons[k] for k in order),
        ranks=tuple(int(k) + 1 for k in order),
        region=problem.region.name,
        now=now,
        then=then,
        curve_mm=curve_mm,
        enough=enough_poses(curve_mm, first=1 if start.measured is None else 0),
        model=unknowns.model.family_names,
        outcome=criterion.outcome(problem, chosen),
        fewest_for_fit=_fewest_for_fit(start, count),
        blocked=_blocked_ways(start, planned),
    )


def _fewest_for_fit(start: Start, count: int) -> int | None:
    """Number of poses that a fit of the link errors needs, where a first plan has fewer than that; else None."""
    least = fewest_poses(start.dataset.robot)
    return least if start.measured is None and count < least else None


def _blocked_ways(start: Start, planned: Poses) -> tuple[tuple[str, str], ...]:
    """Pairs of successive poses between which a joint motion would hit an obstacle."""
    blocked = np.flatnonzero(~clear_ways(start.cell, planned.q))
    return tuple((planned.ids[k], planned.ids[k + 1]) for k in blocked)


def _members(start: Start, offered: Poses, names: Sequence[str], user_effects: Sequence[Family]) -> tuple[Effect, ...]:
    """Effects to plan for: members of the named families that are not yet in the fit.

    Raises CalibError for a family that neither the measured nor the planned poses can test, and for a sparse one.
    """
    if not names:
        return ()
    fit = start.unknowns()
    in_fit = set(fit.parameter_names)
    # Families ask for the order of the poses, here their own and not a later one, and for points.
    anew = replace(offered, order=np.zeros(0), came_from=np.zeros((0, 0)))
    planned = replace(start.dataset, poses=anew, points=fit.points(offered))
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


def _region(start: Start, others: Poses, region: str | BoxRegion, rng: np.random.Generator) -> tuple[str, Poses]:
    """Name and poses of the region in which the planned fit is to be accurate."""
    if isinstance(region, BoxRegion):
        return region.name, start.poses_at(_poses_in(region, start, others.q, rng))
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


def _poses_in(box: BoxRegion, start: Start, q: Array, rng: np.random.Generator) -> Array:
    """Joints (N, n) of measurable poses whose tool point is in a box. Raises CalibError where there are too few."""
    for _ in range(_BOX_TRIES):
        inside = box.contains(start.cell.chain(q).target_mm)
        if np.count_nonzero(inside) >= _FEWEST_IN_BOX:
            break
        q = np.concatenate([q, candidate_poses(start.cell, 2 * len(q), rng=rng)])
    inside = box.contains(start.cell.chain(q).target_mm)
    if np.count_nonzero(inside) < _FEWEST_TEST:
        raise CalibError(
            f"robot {start.cell.robot.name}: {np.count_nonzero(inside)} of {len(q)} poses that can be measured have "
            f"the tool point in {box.name}; give a box that the tool reaches where the instrument sees it"
        )
    return q[inside][:_REGION]


def _curve(problem: DesignProblem, chosen: IndexArray) -> Array:
    """Predicted RMS error (n + 1,), mm, over the region by number of planned poses, continued beyond the plan."""
    region = problem.region_question
    logs = [region.log_value(problem.information(chosen[:k])) for k in range(len(chosen) + 1)]
    some = np.arange(0, len(problem.rows), _THINNED)
    further = min(_BEYOND, int(np.count_nonzero(~np.isin(some, chosen))))
    beyond = replace(region, rows=region.rows[some], prior_information=problem.information(chosen))
    more = best_poses([beyond], further, exclude=np.isin(some, chosen), exchange=False)
    return np.sqrt(np.exp(np.array([*logs, *more.greedy_log_values])) + problem.region.missed_mm2)


def _order(problem: DesignProblem, chosen: IndexArray) -> IndexArray:
    """Order of measuring, as indices: short motions, with equal temperatures and payloads kept together."""
    start, poses = problem.start, problem.candidates.select(chosen)
    at = start.measured.q[np.argmax(start.measured.order)] if start.measured is not None else None
    kept = [values for values in (poses.temperature_c, poses.payload_kg) if values is not None]
    groups = group_numbers(np.column_stack([np.zeros(len(chosen)), *kept]))
    order: list[int] = []
    for group in range(groups.max() + 1):
        rows = np.flatnonzero(groups == group)
        order += rows[order_poses(start.cell, poses.q[rows], at)].tolist()
        at = poses.q[order[-1]]
    return np.array(order, dtype=np.int64)


def _to_measure(problem: DesignProblem, rows: IndexArray, criterion: DesignCriterion) -> Poses:
    """Chosen candidates with new names, and joints rounded to 0.001 deg or mm as a person would type them.

    The first is the reference where the poses are a dataset of their own. A temperature that all share is left out,
    unless it is to be kept.
    """
    measured = problem.start.measured
    ids = new_ids(len(rows), () if measured is None else measured.ids)
    role = np.full(len(rows), "train", dtype="<U9")
    if measured is None or criterion.is_own_dataset:
        role[0] = "reference"
    poses = problem.candidates.select(rows)
    step = np.where(problem.start.dataset.robot.is_revolute, np.radians(_TYPED), _TYPED)
    poses = replace(poses, q=step * np.round(poses.q / step))
    temperature_c = poses.temperature_c
    if not criterion.keeps_temperature and temperature_c is not None and not np.ptp(temperature_c) > 0.0:
        temperature_c = None  # irrelevant to these poses; the value measured then counts, as for the time
    poses = replace(poses, temperature_c=temperature_c, time_s=None)
    return replace(poses, ids=ids, role=role, scan_names=tuple(f"{pose_id}.ply" for pose_id in ids))


def new_ids(count: int, taken: Sequence[str]) -> tuple[str, ...]:
    """Names "p" and a number, in sequence after the highest number taken, with as many digits as the taken names."""
    numbers = [name[1:] for name in taken if name[:1] == "p" and name[1:].isdecimal()]
    first = max((int(number) for number in numbers), default=0) + 1
    width = max((len(number) for number in numbers), default=len(str(count)))
    return tuple(f"p{number:0{width}d}" for number in range(first, first + count))


# ---- a plan from whatever is known ----------------------------------------------------------------------------------


def criterion_of(name: str, *, payload_kg: float | None = None) -> DesignCriterion:
    """Criterion for a name: a purpose that is planned for from any fit, or effects separated by commas.

    Raises CalibError where the name is of none. Other purposes take a diagnosis: `task_of_diagnosis`.
    """
    names = tuple(dict.fromkeys(part.strip() for part in name.split(",") if part.strip()))
    of_any_fit = {purpose.name: purpose.criterion for purpose in purposes().values() if purpose.criterion}
    if len(names) == 1 and names[0] in of_any_fit:
        if payload_kg is not None:
            raise CalibError(f"--payload-kg is for effects that a load shows; --for {name} is planned without")
        criterion: DesignCriterion = load(of_any_fit[names[0]])()
        return criterion
    if not names or of_any_fit.keys() & set(names):
        raise CalibError(f"--for {name}: give {', '.join(of_any_fit)}, or effects with commas between")
    return ForEffects(names, payload_kg)


def task_of_diagnosis(
    purpose: PlanPurpose, diagnosis: Diagnosis, count: int | None, payload_kg: float | None
) -> PlanTask:
    """Poses that serve a purpose after a diagnosis; `count` None leaves their number to it."""
    task: PlanTask = load(purpose.of_diagnosis)(diagnosis, payload_kg, count)
    return task
