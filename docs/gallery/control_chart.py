"""A cell, watched for a year

Eight check poses, measured every second month. From the fourth time on the zero of joint 3 is off by 0.02
degrees, which the chart shows and `watch` names.
"""

from dataclasses import replace

import numpy as np

import calib
from calib.dataset.dataset import About
from calib.dataset.files.robot_toml import builtin_robot
from calib.extras.watch.watch import watch
from calib.simulation.truth.order_effects import JointStep
from inspector import figures

BASE, CHECKS, TIMES = 64, 8, 6
robot = builtin_robot("rb5")
slip_rad = np.zeros(robot.n_joints)
slip_rad[2] = np.radians(0.02)
slip = JointStep(offset_rad=slip_rad, first=BASE + 3 * CHECKS)
rng = np.random.default_rng(2)
year = calib.simulate_dataset(robot, rng=rng, poses=BASE + TIMES * CHECKS, effects=[slip]).dataset


def part(first, count, date):
    """Some poses of the year as a dataset of their own; the first of them is its reference."""
    rows = np.arange(first, first + count)
    poses = year.poses.select(rows)
    poses = replace(poses, role=np.array(["reference"] + ["train"] * (count - 1)))
    points = year.points.select(np.isin(year.points.pose, rows))
    points = replace(points, pose=points.pose - first)
    return replace(year, name=date, poses=poses, points=points, about=About(date=date))


# %%
# The calibration, then six visits.

base = calib.calibrate(part(0, BASE, "2026-01-10"))
dates = [f"2026-{month:02}-10" for month in (2, 4, 6, 8, 10, 12)]
seen = [watch(base, part(BASE + k * CHECKS, CHECKS, date)) for k, date in enumerate(dates)]
print("\n".join(one.headline for one in seen))

# %%

figure = figures.control_chart(seen)
figure.update_layout(title_text="RMS error at the check poses against the limit of an unchanged cell")
figure.show()
