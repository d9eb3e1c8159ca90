"""Would more poses help

Fits to fewer poses than there are tell how the error falls with their number. Where the two lines meet, more
poses of the same kind help no more.
"""

import calib
from calib import learning_curve
from inspector import figures

dataset = calib.load_dataset("sample_data/hidden_effect_a")
curve = learning_curve(dataset)
figure = figures.learning_curve(curve)
figure.update_layout(title_text="Error of fitted and held-out poses against the number of poses fitted")
figure.show()
print(curve.summary())
