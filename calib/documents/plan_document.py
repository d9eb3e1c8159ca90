"""A plan as the command prints it with --json."""

from __future__ import annotations

from typing import Any

from calib.dataset.files.poses_csv import joint_columns, poses_frame
from calib.planning.plan import Plan
from calib.planning.prediction import Prediction


def plan_document(plan: Plan) -> dict[str, Any]:
    """What `inspector plan --json` prints; joints as commanded, in the units that `columns` name."""
    robot = plan.start.dataset.robot
    table = poses_frame(plan.poses, robot)
    columns = joint_columns(robot)
    each = zip(table.to_dict("records"), plan.why, plan.worth, strict=True)
    return {
        "poses": [
            {
                "pose": row["pose"], "role": row["role"], "q": [row[name] for name in columns],
                "why": why, "worth": worth,
                **{str(name): value for name, value in row.items() if name not in ("pose", "role", *columns)},
            }
            for row, why, worth in each
        ],
        "columns": columns,
        "for": plan.purpose.name,
        "region": plan.region,
        "predicted_test_rmse_mm": {"now": plan.now.geometry_mm, "then": plan.then.geometry_mm},
        "band_90_mm": {"now": _band(plan.now), "then": _band(plan.then)},
        "with_noise_mm": {"now": plan.now.with_noise_mm, "then": plan.then.with_noise_mm},
        "curve_mm": plan.curve_mm,
        "enough": plan.enough,
        "settles": plan.power,
        "shots": 1,  # every pose is measured once
        "model": plan.model,
        "told": plan.told,
        "notes": plan.notes,
    }  # fmt: skip


def _band(prediction: Prediction) -> list[float]:
    return [prediction.low_mm, prediction.high_mm]
