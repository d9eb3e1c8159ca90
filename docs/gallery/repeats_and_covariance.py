"""Do covariances hold

A jig that stands still is scanned several times. How far its corners scatter should be what the covariance of each corner says:
their ratio is 1 where it does. What all scans of a place share, such as the scanner's smooth error, is in no repeat.
"""

import numpy as np

import calib
from calib.dataset.repeats import find_repeats, scatter_against_covariances
from calib.measurement.measured_points import with_corners
from inspector.figures.style import figure as figure_of

scans = calib.load_dataset("sample_data/rb5_repeats")
dataset = with_corners(scans, calib.find_corners(scans))
held = scatter_against_covariances(dataset)
print(f"scatter over covariance: {held.ratio:.2f} ({held.freedom} degrees of freedom, p = {held.chance:.2g})")
for place in find_repeats(dataset):
    print(place)
