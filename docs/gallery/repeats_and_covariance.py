"""Do covariances hold

A jig that stands still is scanned several times. How far its corners scatter should be what the covariance of
each corner says: their ratio is 1 where it does. What all scans of a place share, such as the scanner's
smooth error, is in no repeat.
"""

import numpy as np

import calib
from calib.dataset.repeats import find_repeats, scatter_against_covariances
from calib.measurement.measured_points import with_corners
from inspector.figures.style import figure as figure_of

scans = calib.load_dataset("sample_data/rb5_repeats")
dataset = with_corners(scans, calib.find_corners(scans))
held = scatter_against_covariances(dataset)
print(f"scatter over covariance: {held.ratio:.2f} ({held.dof} degrees of freedom, p = {held.p_value:.2g})")

# %%
# Place by place and axis by axis of the scanner; z is depth. Ten scans of a place leave each bar of scatter
# uncertain by a quarter.

labels, scatter, told = [], [], []
for place in find_repeats(dataset):
    rows = [k for k, pose in enumerate(dataset.poses.ids) if pose[:2] == place.label[:2]]
    covariance = dataset.points.covariance_mm2[np.isin(dataset.points.pose, rows)].mean(axis=0)
    labels += [f"{place.label[:2]} {axis}" for axis in "xyz"]
    scatter += place.sigma_mm.tolist()
    told += np.sqrt(np.diag(covariance)).tolist()
bars = {
    "type": "bar",
    "name": "scatter of ten scans",
    "x": labels,
    "y": scatter,
    "marker": {"color": "#0072B2"},
}
marker = {"color": "#D55E00", "size": 10, "symbol": "diamond"}
dots = {"type": "scatter", "mode": "markers", "name": "covariance", "x": labels, "y": told, "marker": marker}
figure = figure_of(
    [bars, dots],
    xaxis={"type": "category", "title": "place and axis", "tickvals": labels, "ticktext": labels},
    yaxis={"title": "standard deviation, mm", "rangemode": "tozero", "automargin": True},
    margin=(50, 12, 44, 42),
)
figure.update_layout(title_text="Scatter of repeated corners and what their covariances say, by place and axis")
figure.show()
