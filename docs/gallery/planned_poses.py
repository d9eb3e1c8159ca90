"""What planned poses promise

Which five poses tell most about the parameters of an arm that was measured before? The plan predicts the
error of the fit that will have them.
"""

import calib
from inspector import figures

fit = calib.calibrate("sample_data/hidden_effect_b", effects=["joint_compliance", "backlash"])
plan = calib.plan(fit, 5)
figure = figures.plan_curve(plan)
figure.update_layout(title_text="Predicted error against the number of new poses")
figure.show()
print("\n".join(line for line in plan.summary().splitlines() if not line.startswith("note")))
