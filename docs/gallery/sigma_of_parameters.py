"""How well each parameter is known

A fit gives each parameter a standard deviation. Here it is held against the error that the parameter really
has, which only a simulation knows. Where the deviations are right, error over deviation is a standard normal
number.
"""

import numpy as np

import calib
from calib.dataset.files.robot_toml import builtin_robot
from inspector.figures.style import figure as figure_of

robot = builtin_robot("rb5")
ratios = []
for seed in range(24):  # arms, each with errors of its own
    made = calib.simulate_dataset(robot, rng=np.random.default_rng(seed), poses=40)
    table = calib.calibrate(made.dataset).to_frame().set_index("name")
    for name, row in table[table["known"]].iterrows():
        kind, joint = name.rstrip("0123456789"), name.lstrip("abcdehlpt")
        if joint.isdigit():
            true = getattr(made.truth.robot.joints[int(joint) - 1], f"{kind}_{row['unit']}")
            ratios.append((row["value"] - true) / row["sigma"])
ratios = np.array(ratios)
inside = np.mean(np.abs(ratios) < 1.0)
print(f"{len(ratios)} parameters of 24 arms: {100 * inside:.0f} % within one sigma (68 % are meant)")

# %%

edges = np.linspace(-4, 4, 33)
middles = 0.5 * (edges[1:] + edges[:-1])
share = np.histogram(ratios, edges)[0] / len(ratios) / np.diff(edges)
normal = np.exp(-0.5 * middles**2) / np.sqrt(2 * np.pi)
steps_x, steps_y = np.repeat(edges, 2), np.r_[0.0, np.repeat(share, 2), 0.0]
figure = figure_of(
    [
        {
            "type": "scatter", "mode": "lines", "x": steps_x.tolist(), "y": steps_y.tolist(),
            "name": "fitted parameters", "line": {"color": "#0072B2", "width": 2},
        },
        {
            "type": "scatter", "mode": "lines", "x": middles.tolist(), "y": normal.tolist(),
            "name": "standard normal", "line": {"color": "#D55E00", "width": 2},
        },
    ],
    xaxis={"title": "error of a parameter over its standard deviation"},
    yaxis={"title": "density", "rangemode": "tozero"},
    margin=(50, 12, 44, 42),
)  # fmt: skip
figure.update_layout(title_text="Errors of fitted parameters over their standard deviations, against a standard normal")
figure.show()
