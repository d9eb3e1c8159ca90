"""How well each parameter is known

A fit gives each parameter a standard deviation. Here it is held against the error that the parameter really has, which only a
simulation knows: of 24 arms, each with errors of its own, about two thirds should lie within one sigma.
"""

import numpy as np

import calib
from calib.dataset.files.robot_toml import builtin_robot
from inspector.figures.style import figure as figure_of

robot = builtin_robot("rb5")
names = ["a2", "a3", "d5", "alpha2", "theta2", "theta3"]
errors, sigmas = [], []
for seed in range(24):
    made = calib.simulate_dataset(robot, rng=np.random.default_rng(seed), poses=40)
    fitted = calib.calibrate(made.dataset)
    table = fitted.to_frame().set_index("name")
    print(table.head()) if seed == 0 else None
