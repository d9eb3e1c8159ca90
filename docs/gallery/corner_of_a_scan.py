"""The corner of a scan, with its planes

A simulated structured-light scan of the jig, with smooth noise, mixed pixels at the edges, and a wall and a
table behind. The search finds three planes and the point where they meet; it is told nothing of the pose.
"""

import numpy as np

import calib
from calib.dataset.files.robot_toml import builtin_robot
from inspector.figures.style import figure as figure_of

rng = np.random.default_rng(4)
made = calib.simulate_dataset(builtin_robot("rb5"), rng=rng, poses=12, scans=True)
scan = made.scan(3)
search = calib.find_corner(scan.scan, made.dataset.jig)
print(search.summary())
print(f"off the true corner by {np.linalg.norm(search.corner.xyz_mm - scan.apex_mm):.3f} mm")

# %%
# Seen by the scanner: each face in its colour, what belongs to none grey, and the corner with its three
# edges.

points = scan.scan.points_mm[::4] - search.corner.xyz_mm
near = np.linalg.norm(points, axis=1) < 110
on_face = np.full(len(scan.scan.points_mm), -1)
for k, face in enumerate(search.corner.faces):
    on_face[face.inliers] = k
on_face = on_face[::4]
traces = []
for k, (name, colour) in enumerate(
    [("other points", "#8a8f98"), ("face 1", "#0072B2"), ("face 2", "#E69F00"), ("face 3", "#009E73")],
    start=-1,
):
    x, y = points[near & (on_face == k), :2].T.tolist()
    marker = {"color": colour, "size": 3}
    traces.append({"type": "scatter", "mode": "markers", "name": name, "x": x, "y": y, "marker": marker})
normals = [face.normal for face in search.corner.faces]
for k in range(3):
    edge = np.cross(normals[(k + 1) % 3], normals[(k + 2) % 3])
    edge *= -np.sign(edge @ normals[k]) * search.corner.outline.edges_mm[k] / np.linalg.norm(edge)
    line = {"color": "#D55E00", "width": 2}
    traces.append(
        {
            "type": "scatter", "mode": "lines", "x": [0.0, float(edge[0])], "y": [0.0, float(edge[1])],
            "line": line, "showlegend": k == 0, "name": "edges of the jig",
        }
    )  # fmt: skip
figure = figure_of(
    traces,
    xaxis={"title": "x from the corner, mm", "range": [-115, 115]},
    yaxis={"title": "y from the corner, mm", "range": [-80, 80], "automargin": True},
    margin=(50, 12, 44, 42),
)
figure.update_layout(title_text="The points of a scan by the face that they belong to, and the jig's edges", height=520)
figure.show()
