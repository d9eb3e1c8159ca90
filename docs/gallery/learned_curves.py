"""What has no name is learned

Gears that run unevenly all along their range, with waves that no turn brings back: no effect of the catalogue
makes that. A smooth curve for each joint is fitted with everything else, if poses that were left out are
predicted better with it.
"""

import numpy as np

import calib
from calib.dataset.files.robot_toml import builtin_robot
from inspector import figures

rng = np.random.default_rng(3)
made = calib.simulate_dataset(builtin_robot("rb5"), rng=rng, poses=160, effects=[("rough_gear", 6.0)])
found = calib.diagnose(made.dataset)
print(found.to_frame().to_string(index=False))

# %%
# Grey is where nothing was measured, the band two sigmas. Such a curve names no cause; it predicts.

figure = figures.learned_curves(found)
figure.update_layout(title_text="Learned error of the joints over their inputs, with bands of two sigmas")
figure.show()
