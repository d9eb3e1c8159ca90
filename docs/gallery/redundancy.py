"""Which parameters act alike

Two parameters whose effect on all measured points is the same cannot both be known. Park et al. 2022 find
them by Pearson's correlation of the Jacobian's columns.
"""

import calib
from calib import redundancy
from inspector import figures

dataset = calib.load_dataset("sample_data/hidden_effect_a")
analysis = redundancy(dataset)
figure = figures.redundancy_heatmap(analysis)
figure.update_layout(title_text="Correlation of all pairs of link parameters", height=560)
figure.show()
