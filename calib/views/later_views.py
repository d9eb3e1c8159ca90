"""What comes after a calibration, as a notebook shows it: a plan, a watched cell, two arms compared."""

from __future__ import annotations

import numpy as np

from calib.planning.plan import Plan
from calib.planning.prediction import PAYS, STEP
from calib.planning.words import heading
from calib.present.blocks import Block, Bullets, Facts, Paragraph, Section, Table, Verdict
from calib.present.colours import DOUBT, GOOD
from calib.views.view_page import view_html


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
    if plan.settles is not None:
        said = f"Probability that these poses settle it: {100 * plan.settles:.0f} %"
        head.append(Verdict(said, GOOD if plan.settles >= 0.8 else DOUBT))
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
