"""The tab Plan as HTML: what a plan promises, and its poses."""

from __future__ import annotations

import numpy as np

from calib.planning.plan import Plan
from calib.planning.prediction import PAYS, STEP
from calib.robot_formats.programs import JOINTS
from inspector.markup.parts import elements
from inspector.markup.parts.palette import DOUBT, GOOD

SURELY = 0.8  # probability from which a set counts as good as settled


def promise_html(plan: Plan) -> str:
    """What the poses are for, the error now and then, and how surely what is open is settled."""
    pairs: list[tuple[str, object]] = [
        ("predicted error now", plan.now.words),
        ("with these poses", plan.then.words),
        ("more poses", _more(plan)),
    ]
    settled = ""
    if plan.power is not None:
        colour = GOOD if plan.power >= SURELY else DOUBT
        said = f"Probability that these poses settle it: {100 * plan.power:.0f} %"
        settled = elements.alert(said, colour=colour)
    told = elements.bullets(plan.told) if plan.told else ""
    return settled + told + elements.facts(pairs)


def _more(plan: Plan) -> str:
    if plan.enough is None:
        return f"pay: {STEP} more lower it by over {100 * PAYS:.0f} %"
    return f"from {plan.enough} on, {STEP} more lower it by less than {100 * PAYS:.0f} %"


def poses_html(plan: Plan, shown: int | None) -> str:
    """The poses in the order of measuring, a click shows one in 3D; `shown` is marked."""
    robot, poses = plan.start.dataset.robot, plan.poses
    commanded = robot.commands_of(poses.q)
    values = np.where(robot.is_revolute, np.degrees(commanded), commanded)
    units = "degrees" if robot.is_revolute.all() else "degrees, mm where a joint slides"
    loaded = poses.payload_kg is not None and bool(np.any(poses.payload_kg))
    head = ["pose", f"joints, {units}", *(["kg"] if loaded else []), "why"]
    rows = []
    for k, name in enumerate(poses.ids):
        joints = elements.wrapping(", ".join(f"{v:.1f}" for v in values[k]))
        payload = [f"{poses.payload_kg[k]:g}"] if loaded and poses.payload_kg is not None else []
        rows.append([name, joints, *payload, elements.wrapping(plan.why[k])])
    asks = [elements.asking("planned", k) for k in range(len(poses))]
    return elements.table(head, rows, left=len(head), mark=shown, asks=asks)


def notes_html(plan: Plan) -> str:
    """What was assumed, and for which arms URScript is."""
    robot = plan.start.dataset.robot
    notes = list(plan.notes)
    if robot.is_revolute.tolist() != [True] * JOINTS:
        notes.append("URScript takes six turning joints; for this arm take poses.csv or the ROS trajectory")
    return elements.heading("What was assumed") + elements.bullets(notes) if notes else ""
