"""What is left, over a joint's angle

What a fit leaves over is no noise where it follows a joint. Here the gear of joint 2 has an error that
repeats with the joint's turn. The same figure is drawn before and after the effect is in the model.
"""

import numpy as np

import calib
from calib.dataset.files.robot_toml import builtin_robot
from calib.simulation.truth.joint_effects import TransmissionError
from inspector import figures

robot = builtin_robot("rb5")
sizes = np.zeros((robot.n_joints, 3))
sizes[1, 1] = 6e-4  # rad: twice a turn of joint 2
gear = TransmissionError(cos_rad=sizes, sin_rad=np.zeros_like(sizes))
made = calib.simulate_dataset(robot, rng=np.random.default_rng(5), poses=120, effects=[gear])
links_only = calib.calibrate(made.dataset)
figure = figures.residuals_over(links_only, "q2", show=2)
figure.update_layout(title_text="Before: what is left, as a motion of joint 2, over its angle")
figure.show()

# %%
# The diagnosis finds it, on that joint.

found = calib.diagnose(made.dataset)
print(found.summary().splitlines()[-1])
figure = figures.residuals_over(found, "q2", show=2)
figure.update_layout(title_text="After: what is left with the effect in the model")
figure.show()
