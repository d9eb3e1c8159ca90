"""A plan in words: a table of poses, the error before and after, when more poses no longer pay."""

from __future__ import annotations

from calib.dataset.files.poses_csv import approach_columns, poses_frame
from calib.planning.plan import Plan
from calib.planning.prediction import PAYS, STEP
from calib.planning.purpose import WATCH, ForCalibration

_SHOWN = (0, 5, 10, 15, 20, 30, 40, 50)  # counts of poses of the curve that are told


def plan_text(plan: Plan) -> str:
    """The plan as a terminal shows it."""
    table = poses_frame(plan.poses, plan.start.dataset.robot)
    sides = approach_columns(plan.start.dataset.robot)
    columns = [name for name in table.columns if name not in ("role", "setup", *sides)]
    if plan.poses.approach is not None:
        signs = ["".join("+" if side > 0 else "-" for side in row) for row in plan.poses.approach]
        table, columns = table.assign(approach=signs), [*columns, "approach"]
    table = table[columns].assign(rank=plan.worth, tells=plan.why)
    rows = table.to_string(index=False, float_format=lambda v: f"{v:.1f}", justify="left").splitlines()
    lines = [heading(plan), *(row.rstrip() for row in rows), *plan.told]
    lines += [] if plan.purpose.name == WATCH else error_lines(plan)
    return "\n".join([*lines, *(f"note: {note}" for note in plan.notes)])


def heading(plan: Plan) -> str:
    """What the poses are for."""
    count, name = len(plan.poses), plan.start.dataset.name
    purpose = plan.purpose
    aim = "to watch the cell" if purpose.name == WATCH else f"for {purpose.name}"
    if isinstance(purpose, ForCalibration):
        aim = "to know the parameters (D-optimal)" if purpose.criterion == "D" else f"to be right at {plan.region}"
        aim += " (I-optimal)" if purpose.criterion == "I" else ""
    said = "" if count == 1 else "; rank 1 tells most, the last ranks can be left out first"
    return f"{count} pose{'' if count == 1 else 's'} for {name}, {aim}{said}"


def error_lines(plan: Plan) -> list[str]:
    """The predicted error, and when more poses no longer pay."""
    before = "before any calibration" if plan.start.measured is None else "now"
    out = [
        f"predicted error of the model at {plan.region}: {before} {plan.now.words}, then {plan.then.words}; "
        f"as measured there, with a point's noise: {plan.then.with_noise_mm:.2g} mm"
    ]
    usable = range(len(plan.curve_mm))
    told = [f"{k}: {plan.curve_mm[k]:.2g}" for k in _SHOWN if k in usable and _is_told(plan, k)]
    out.append(f"by the number of new poses, mm: {', '.join(told)}")
    share = f"{100 * PAYS:.0f} %"
    if plan.enough is None:
        out.append(f"more poses pay: {STEP} more lower it by over {share}, up to {len(plan.curve_mm) - 1} new ones")
    else:
        out.append(f"from {plan.enough} new poses on, {STEP} more lower it by less than {share}")
    if plan.power is not None:
        out.append(f"probability that these poses settle it: {100 * plan.power:.0f} %")
    return out


def _is_told(plan: Plan, count: int) -> bool:
    """Fewer poses than it takes to place the scanner, or to fit at all, have no error worth telling."""
    return bool(plan.curve_mm[count] <= 1.001 * plan.now.geometry_mm)
