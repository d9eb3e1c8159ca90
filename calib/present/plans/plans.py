"""Presentation of a plan of poses: purpose, predicted gain, each pose with its reason, and assumptions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import singledispatch
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.calibration.noise_level import check_sigma
from calib.dataset.files.poses_csv import joint_columns, poses_frame
from calib.planning.criterion import (
    DiscriminationOutcome,
    EffectOutcome,
    ForCalibration,
    Outcome,
    ParameterReason,
    PoseReason,
    SeparationReason,
)
from calib.planning.plan import Plan
from calib.planning.prediction import PAYS, STEP, Prediction
from calib.planning.start import FromFit, FromRobot
from calib.planning.ways import passed, via_names
from calib.present.results import document, loads_makers, presentation
from calib.rendering import numbers
from calib.rendering.blocks import (
    Block,
    Bullets,
    Facts,
    FigurePlace,
    Paragraph,
    Presentation,
    Reference,
    Section,
    Table,
    Verdict,
)
from calib.rendering.colours import DOUBT, GOOD

SURELY = 0.8  # power from which a set of hypotheses counts as good as discriminated
_COUNTS = (0, 5, 10, 15, 20, 30, 40, 50)  # of new poses, whose predicted error the table has
_GAINS = 0.9  # of a sigma before, above which a coefficient gains next to nothing
_COEFFICIENTS = 8  # that are listed
_CONDITIONS = {  # that poses are to be measured under
    "approach": "come to each pose with every joint from the side in approach1 ...",
    "payload_kg": "mount each payload once, for all its poses",
    "temperature_c": "measure the cold poses first; write down the temperatures",
}
_TITLES = {"payload_kg": "payload, kg", "temperature_c": "temperature, °C"}  # of columns of poses.csv
_RANKS = "Rank 1 is the most informative; leave out the poses of the last ranks first."


@dataclass(frozen=True)
class Told:
    """What is told of what planned poses achieve."""

    aim: str = ""  # phrase for the headline: "to watch the cell"; "" where the criterion has it
    of_error: bool = True  # whether the predicted error is told, too
    blocks: Sequence[Block] = ()
    sentences: Sequence[str] = ()
    document: Mapping[str, Any] = field(default_factory=dict)  # keys of `--json`


@dataclass(frozen=True)
class ReasonTold:
    """What is told of the reason for a pose."""

    phrase: str
    document: Mapping[str, Any] = field(default_factory=dict)  # keys of the pose in `--json`


@singledispatch
def told(outcome: Outcome | None) -> Told:
    """What is told of an outcome, by its class."""
    return told(outcome) if outcome is not None and loads_makers() else Told()


@singledispatch
def reason_told(reason: PoseReason) -> ReasonTold:
    """What is told of the reason for a pose, by its class."""
    return reason_told(reason) if loads_makers() else ReasonTold("")


@presentation.register
def _plan(plan: Plan) -> Presentation:
    return Presentation(
        f"Plan for {plan.start.dataset.name}",
        plan_head(plan),
        [
            Section("The poses, in the order of measuring", pose_blocks(plan), brief=True),
            *([Section("More poses", [_error_by_count(plan)], brief=True)] if told(plan.outcome).of_error else []),
            Section("What was assumed", [Bullets(assumptions(plan))], brief=True),
        ],
    )


def plan_head(plan: Plan) -> list[Block]:
    """Blocks with the purpose of the poses and their predicted gain."""
    unsure = plan.power is not None and plan.power < SURELY
    achieved = told(plan.outcome)
    verdict = Verdict(plan_headline(plan), DOUBT if unsure else GOOD)
    head: list[Block] = [verdict, *achieved.blocks, Bullets(achieved.sentences)]
    if not achieved.of_error:
        return head
    caption = "The predicted error by the number of new poses."
    return [*head, Facts(_predicted(plan)), FigurePlace("plan_curve", (plan,), caption, height_px=260)]


def plan_headline(plan: Plan) -> str:
    """Sentence with the number and purpose of the poses, and the predicted error or the power."""
    criterion, planned = plan.criterion, numbers.count(len(plan.poses), "pose")
    error = f"the predicted error falls {numbers.length_change(plan.now.geometry_mm, plan.then.geometry_mm)}"
    achieved = told(plan.outcome)
    if plan.power is not None:
        error = f"the probability that they do is {numbers.share(plan.power)}"
    elif not achieved.of_error:
        error = ""
    if achieved.aim:
        aim = achieved.aim
    elif isinstance(criterion, ForCalibration):
        aim = f"to be right at {plan.region} (I-optimal)"
    else:
        aim = f"for {numbers.listing(criterion.effects)}"
    return f"{planned} for {plan.start.dataset.name}, {aim}{f': {error}' if error else ''}."


def _predicted(plan: Plan) -> list[tuple[str, object]]:
    before = "before any calibration" if plan.start.measured is None else "now"
    share = numbers.share(PAYS)
    more = f"{STEP} more lower it by over {share}, up to {len(plan.curve_mm) - 1} new ones"
    if plan.enough is not None:
        more = f"from {plan.enough} new ones on, {STEP} more lower it by less than {share}"
    return [
        ("predicted error at", plan.region),
        (before, _error(plan.now)),
        ("with these poses", _error(plan.then)),
        ("as measured there", f"{numbers.length(plan.then.with_noise_mm)}, with a point's noise"),
        ("more poses", more),
    ]


def _error(predicted: Prediction) -> str:
    low, high = numbers.length(predicted.low_mm), numbers.length(predicted.high_mm)
    return f"{numbers.length(predicted.geometry_mm)} (90 % of arms: {low} to {high})"


def _error_by_count(plan: Plan) -> Table:
    """Table of the predicted error by the number of new poses.

    Fewer poses than it takes to place the scanner, or to fit at all, have no error that means anything.
    """
    counts = [k for k in _COUNTS if k < len(plan.curve_mm) and plan.curve_mm[k] <= 1.001 * plan.now.geometry_mm]
    errors = [numbers.column_mm(float(plan.curve_mm[k])) for k in counts]
    return Table(("new poses", *map(str, counts)), [("predicted error, mm", *errors)])


# ---- what the poses achieve -----------------------------------------------------------------------------------------


@told.register
def _of_effects(outcome: EffectOutcome) -> Told:
    return Told(sentences=[*_conditions(outcome), *_coefficients(outcome)])


@told.register
def _of_discrimination(outcome: DiscriminationOutcome) -> Told:
    aim = f"to discriminate between {numbers.listing(outcome.hypotheses)}"
    return Told(aim, sentences=_discriminated(outcome))


def _conditions(outcome: EffectOutcome) -> list[str]:
    return [
        f"{way}{'; poses.csv needs it of the measured poses too' if name in outcome.unrecorded else ''}"
        for name, way in _CONDITIONS.items()
        if name in outcome.conditions
    ]


def _coefficients(outcome: EffectOutcome) -> list[str]:
    better = [c for c in outcome.coefficients if c.after < _GAINS * c.before]
    most = sorted(better, key=lambda c: c.after / c.before)[:_COEFFICIENTS]
    lines = [
        f"sigma of {c.name}: {numbers.size(c.before, c.unit)} → {numbers.size(c.after, c.unit)}"
        for c in outcome.coefficients
        if c in most
    ]
    of = len(outcome.coefficients)
    rest = of - len(most)
    return [*lines, *([f"{numbers.count(rest, 'further coefficient')} of {of} gain less or nothing"] if rest else [])]


def _discriminated(outcome: DiscriminationOutcome) -> list[str]:
    curve = ", ".join(f"{k}: {numbers.share(p)}" for k, p in enumerate(outcome.power_by_count) if k)
    lines = [
        f"probability that {numbers.listing(outcome.hypotheses)} are discriminated, by the number of poses: {curve}"
    ]
    lines += [
        f"{one} and {other} predict the same at every pose of this kind, which cannot discriminate between them"
        for one, other in outcome.equivalent
    ]
    if outcome.enough is not None:
        share = numbers.share(outcome.enough_power)
        lines.append(f"{outcome.enough} poses of this kind would discriminate in {share} of such cases")
    if outcome.payload_kg is not None:
        lines.append(
            f"a known payload at some of the poses discriminates better (--payload-kg {outcome.payload_kg:g} or above)"
        )
    lines += [f"what shows {name} alone: {text}" for name, text in outcome.confirm]
    if outcome.untested:
        would = f"; {outcome.would_help}" if outcome.would_help else ""
        lines.append(f"no pose discriminates {numbers.listing(outcome.untested)}, which these data cannot test{would}")
    return lines


# ---- the poses ------------------------------------------------------------------------------------------------------


def pose_blocks(plan: Plan) -> list[Block]:
    """Blocks with each pose as commanded, in the order of measuring, and the meaning of the ranks."""
    return [poses_table(plan), Paragraph(_RANKS if len(plan.poses) > 1 else "", soft=True)]


def poses_table(plan: Plan, *, compact: bool = False, mark: int | None = None) -> Table:
    """Table of the poses as commanded, with conditions, in the order of measuring; a click on a row selects the pose.

    compact: all joints in one column and no ranks, for a narrow panel.
    """
    robot, poses = plan.start.dataset.robot, plan.poses
    frame = poses_frame(poses, robot)
    joints = [[numbers.signed(v, "z.1f") for v in row] for row in frame[joint_columns(robot)].to_numpy()]
    columns: dict[str, Sequence[object]] = {"pose": poses.ids}
    if compact:
        columns["joints, ° or mm"] = [", ".join(row) for row in joints]
    else:
        units = ["°" if turns else "mm" for turns in robot.is_revolute]
        columns |= {f"q{k + 1}, {unit}": [row[k] for row in joints] for k, unit in enumerate(units)}
    for name, title in _TITLES.items():
        if name in frame and any(frame[name]):
            columns[title] = [f"{value:g}" for value in frame[name]]
    if poses.approach is not None and not compact:
        columns["approach"] = ["".join("+" if side > 0 else numbers.MINUS for side in row) for row in poses.approach]
    if not compact:
        columns["rank"] = plan.ranks
    columns["determines best"] = [reason_told(reason).phrase for reason in plan.reasons]
    return Table(
        list(columns),
        list(zip(*columns.values(), strict=True)),
        left=range(len(columns)) if compact else (0, len(columns) - 1),
        mark=mark,
        rows_select=[Reference("planned", k, name) for k, name in enumerate(poses.ids)],
    )


@reason_told.register
def _by_parameters(reason: ParameterReason) -> ReasonTold:
    far = "" if reason.far_joint is None else f"joint {reason.far_joint} far from what was measured: "
    return ReasonTold(f"{far}{', '.join(reason.parameters) or 'a little of everything'}")


@reason_told.register
def _by_separation(reason: SeparationReason) -> ReasonTold:
    return ReasonTold(f"the hypotheses differ by {numbers.length(reason.separation_mm)} here, refitted")


# ---- what was assumed -----------------------------------------------------------------------------------------------


def assumptions(plan: Plan) -> list[str]:
    """Sentences on the plan's assumptions, on what the prediction cannot include, and on precautions."""
    start, lines = plan.start, []
    if plan.fewest_for_fit is not None:
        lines.append(
            f"{numbers.count(len(plan.poses), 'pose is', 'poses are')} too few for a fit of the links, which "
            f"takes {plan.fewest_for_fit} and better three times as many"
        )
    if plan.blocked:
        lines.append(_blocked(plan))
    if isinstance(start, FromFit):
        lines += _of_fit(start)
    elif isinstance(start, FromRobot):
        noise = f"noise of {numbers.length(start.noise_mm)} per coordinate of a measured point"
        lines.append(f"{noise}, and errors within their tolerances")
    return [*lines, *start.cell.notes]


def _blocked(plan: Plan) -> str:
    """Sentence on straight ways that are blocked, and on the points that lead around where some were found."""
    way_to = dict(zip(plan.poses.ids, plan.ways, strict=True))
    ways = ", ".join(f"{one} to {other}" for one, other in plan.blocked)
    words = f"moving all joints at once leads through floor, box, instrument or the arm itself: {ways}; go around"
    around = [other for _, other in plan.blocked if way_to[other].clear]
    if not around:
        return words
    by = f"as programs and point lists do, by {numbers.listing([f'{name}_via1' for name in around])}"
    return f"{words}, {by}" + ("" if len(around) == len(plan.blocked) else "; no free way was found for the others")


def _of_fit(start: FromFit) -> list[str]:
    lines, check = [], check_sigma(start.calibration)
    if left_out := start.calibration.fitted_dataset.left_out:
        lines.append(f"the fit is without {numbers.listing(left_out)}")
    if start.diagnosed is not None:
        added = numbers.listing(start.calibration.model.family_names) or "nothing that holds"
        lines.append(
            f"calibrated links alone leave {numbers.times(start.diagnosed.noise_ratio)} the declared noise; the model "
            f"is that of the diagnosis, which added {added}"
        )
        if start.diagnosed.confounded:
            lines.append(
                "the diagnosis left effects confounded: --for split plans poses that discriminate between them"
            )
    if check.verdict == "excess" and check.declared_mm:
        ratio = numbers.times(check.sigma_mm / check.declared_mm)
        lines.append(
            f"the fit leaves {ratio} the declared noise, so something is missing from the model: the prediction covers "
            "the errors of its parameters alone, and what is missing may be larger away from the measured poses"
        )
    elif check.verdict == "unknown":
        lines.append("no noise of the points is declared: the residual of the fit is taken for noise")
    if start.calibration.residual == "pose":
        lines.append(
            "the poses are chosen by the places that they give; the attitudes, which this fit takes too, add to it"
        )
    elif start.calibration.residual != "position":
        lines.append(f"planned as for a fit of positions; this one is of {start.calibration.residual}")
    return lines


# ---- the document ---------------------------------------------------------------------------------------------------


@document.register
def _plan_document(plan: Plan) -> dict[str, Any]:
    robot = plan.start.dataset.robot
    columns = joint_columns(robot)
    reasons = map(reason_told, plan.reasons)
    each = zip(poses_frame(plan.poses, robot).to_dict("records"), reasons, plan.ranks, strict=True)
    return {
        "poses": [
            {
                "pose": row["pose"], "role": row["role"], "q": [row[name] for name in columns],
                "why": reason.phrase, "worth": worth, **reason.document,
                **{str(name): value for name, value in row.items() if name not in ("pose", "role", *columns)},
            }
            for row, reason, worth in each
        ],
        "columns": columns,
        "for": plan.criterion.name,
        "region": plan.region,
        "predicted_test_rmse_mm": {"now": plan.now.geometry_mm, "then": plan.then.geometry_mm},
        "band_90_mm": {"now": _band(plan.now), "then": _band(plan.then)},
        "curve_mm": plan.curve_mm,
        "enough": plan.enough,
        "settles": plan.power,
        **told(plan.outcome).document,
        "ways": _ways_document(plan),
        "model": plan.model,
        "told": told(plan.outcome).sentences,
        "notes": assumptions(plan),
    }  # fmt: skip


def _ways_document(plan: Plan) -> list[dict[str, Any]]:
    """Points that the arm passes on its way to each pose, with values as those of the poses."""
    robot = plan.start.dataset.robot

    def values(q: Array) -> list[list[float]]:
        commanded = robot.commands_of(q)
        return np.round(np.where(robot.is_revolute, np.degrees(commanded), commanded), 6).tolist()

    return [
        {
            "pose": name,
            "clear": way.clear,
            "through": [
                {"name": via, "q": q} for via, q in zip(via_names(name, way), values(passed(way)), strict=True)
            ],
        }
        for name, way in zip(plan.poses.ids, plan.ways, strict=True)
    ]


def _band(prediction: Prediction) -> list[float]:
    return [prediction.low_mm, prediction.high_mm]
