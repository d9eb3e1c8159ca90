"""What comes after a calibration, as a notebook shows it: a plan, a watched cell, two arms compared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.display.blocks import Block, Bullets, Facts, KeyFigures, Paragraph, Section, Table, VerdictLine
from calib.display.colours import DOUBT, GOOD, VERDICT_COLOURS
from calib.display.view_page import view_html
from calib.monitoring.control_chart import shown_size
from calib.monitoring.watch import Watched
from calib.planning.plan import Plan
from calib.planning.prediction import PAYS, STEP
from calib.planning.words import heading
from calib.validation.comparison import Comparison, readable

_APART = 2.0  # sigmas from which a parameter is listed as different


def plan_html(plan: Plan) -> str:
    """A plan as HTML: the error now and then, the poses in the order of measuring, why each, what was assumed."""
    return view_html(f"Plan for {plan.start.dataset.name}", plan_head(plan), plan_sections(plan))


def plan_head(plan: Plan) -> list[Block]:
    """What the poses are for, and the error now and then."""
    share = f"{100 * PAYS:.0f} %"
    more = f"up to {len(plan.curve_mm) - 1} new ones pay, {STEP} more lower it by over {share}"
    if plan.enough is not None:
        more = f"from {plan.enough} new ones on, {STEP} more lower it by less than {share}"
    pairs: list[tuple[str, object]] = [
        ("predicted error now", plan.now.words),
        ("with these poses", plan.then.words),
        ("more poses", more),
    ]
    head: list[Block] = [Paragraph(f"{heading(plan)}."), Facts(pairs)]
    if plan.power is not None:
        said = f"Probability that these poses settle it: {100 * plan.power:.0f} %"
        head.append(VerdictLine(said, GOOD if plan.power >= 0.8 else DOUBT))
    return [*head, *([Bullets(plan.told)] if plan.told else [])]


def plan_sections(plan: Plan) -> list[Section]:
    """The poses, and what was assumed."""
    robot, poses = plan.start.dataset.robot, plan.poses
    shown = np.where(robot.is_revolute, np.degrees(robot.commands_of(poses.q)), robot.commands_of(poses.q))
    units = ["°" if turns else "mm" for turns in robot.is_revolute]
    columns = ("pose", "rank", *(f"q{k + 1}, {unit}" for k, unit in enumerate(units)), "tells most of")
    rows = [(name, plan.worth[k], *(f"{v:.1f}" for v in shown[k]), plan.why[k]) for k, name in enumerate(poses.ids)]
    sections = [Section("The poses, in the order of measuring", [Table(columns, rows, left=(0, len(columns) - 1))])]
    return [*sections, *([Section("What was assumed", [Bullets(plan.notes)])] if plan.notes else [])]


def watched_html(seen: Watched) -> str:
    """A later measurement of a cell as HTML: what changed, each joint and the tool, what could not have been seen."""
    return view_html(f"Watch: {seen.name}", watched_head(seen), watched_sections([seen]))


def watched_head(seen: Watched) -> list[Block]:
    """The verdict, and the error against its limit."""
    pairs: list[tuple[str, object]] = [
        ("check poses", seen.poses),
        ("3D error, RMS", f"{seen.rmse_mm:.3g} mm"),
        ("limit where nothing changed", f"{seen.errors.limit_mm:.3g} mm"),
    ]
    return [VerdictLine(seen.headline, VERDICT_COLOURS[seen.verdict]), KeyFigures(pairs)]


def watched_sections(seen: Sequence[Watched]) -> list[Section]:
    """Each joint's zero and the tool, a column a measurement; what the poses of the last could not see."""
    names = ["tool" if found.joint is None else f"zero of joint {found.joint}" for found in seen[-1].usual]
    units = ["°" if found.unit == "rad" else found.unit for found in seen[-1].usual]
    rows = [
        (f"{name}, {unit}", *(_size(*shown_size(w.usual[k])) for w in seen))
        for k, (name, unit) in enumerate(zip(names, units, strict=True))
    ]
    sections = [Section("Every joint and the tool", [Table(("", *(w.name for w in seen)), rows)])]
    unseen = seen[-1].unseen_words
    return [*sections, *([Section("What these poses could not see", [Bullets(unseen)])] if unseen else [])]


def _size(size: float, sigma: float) -> str:
    return f"{size:+.2g} ± {sigma:.1g}" if sigma < 1e6 else "not seen"


def comparison_html(compared: Comparison) -> str:
    """A comparison as HTML: what differs, and every parameter that is more than two sigmas apart."""
    rows = []
    for p in sorted(compared.parameters, key=lambda p: -abs(p.z)):
        if abs(p.z) >= _APART:
            (first, unit), (second, _) = (readable(value, p.unit) for value in p.values)
            by, sigma = readable(p.difference, p.unit)[0], readable(p.sigma, p.unit)[0]
            shown = unit.replace("deg", "°")
            rows.append((p.name, f"{first:.6g}", f"{second:.6g}", f"{by:+.3g}", f"{sigma:.2g}", shown))
    columns = ("parameter", *compared.names, "difference", "sigma", "unit")
    head = [VerdictLine(compared.headline, DOUBT if compared.differs else GOOD)]
    table = Table(columns, rows, left=(0, 5), caption="parameters that are more than two sigmas apart")
    return view_html(" and ".join(compared.names), head, [Section("Parameters", [table])] if rows else [])
