"""Before and after a repair

Two calibrations of one arm, with a repair between them that moved the zero of joint 2. Which parameter has
changed, by how much, and is it more than noise?
"""

from dataclasses import replace

import numpy as np

import calib
from calib import compare
from calib.dataset.files.robot_toml import builtin_robot
from calib.simulation.truth.order_effects import JointStep
from inspector.figures.style import figure as figure_of

robot = builtin_robot("rb5")
shift_rad = np.zeros(robot.n_joints)
shift_rad[1] = np.radians(0.1)
repair = JointStep(offset_rad=shift_rad, first=60)
rng = np.random.default_rng(8)
both = calib.simulate_dataset(robot, rng=rng, poses=120, effects=[repair]).dataset


def half(rows, name):
    """A dataset of some of the poses; the first of them is its reference."""
    poses = both.poses.select(rows)
    poses = replace(poses, role=np.array(["reference"] + ["train"] * (len(rows) - 1)))
    points = both.points.select(np.isin(both.points.pose, rows))
    return replace(both, name=name, poses=poses, points=replace(points, pose=points.pose - rows[0]))


before = calib.calibrate(half(np.arange(60), "before"))
after = calib.calibrate(half(np.arange(60, 120), "after"))
comparison = compare(before, after)
print(comparison.headline)

# %%
# Each parameter's difference in its own sigmas: one stands out, the others are noise.

apart = [p for p in comparison.parameters if p.sigma > 0]
names = [p.name for p in apart]
bars = [
    {
        "type": "bar", "name": name, "x": [p.name for p in apart if far(p.z)], "y": [p.z for p in apart if far(p.z)],
        "marker": {"color": colour},
    }
    for name, colour, far in (
        ("beyond 4 sigmas", "#D55E00", lambda z: abs(z) > 4),
        ("within", "#0072B2", lambda z: abs(z) <= 4),
    )
]  # fmt: skip
figure = figure_of(
    bars,
    xaxis={
        "type": "category", "categoryorder": "array", "categoryarray": names,
        "tickangle": -45, "tickvals": names, "ticktext": names,
    },
    yaxis={"title": "difference, sigmas"},
    margin=(50, 12, 44, 70),
)  # fmt: skip
figure.update_layout(title_text="Difference of each link parameter over its sigma")
figure.show()
