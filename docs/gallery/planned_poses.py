"""What planned poses promise

Which five poses tell most about the parameters of an arm that was measured before? The plan predicts the
error of the fit that will have them.
"""

import calib
from calib.planning.plan import plan_poses
from calib.planning.start import start_of_dataset
from inspector import figures

dataset = calib.load_dataset("sample_data/hidden_effect_b")
start = start_of_dataset(dataset, calib.FitOptions(), effects=["joint_compliance", "backlash"])
plan = plan_poses(start, 5, candidates=200)
figure = figures.plan_curve(plan)
figure.update_layout(title_text="Predicted error against the number of new poses")
figure.show()
print("\n".join(line for line in plan.summary().splitlines() if not line.startswith("note")))
