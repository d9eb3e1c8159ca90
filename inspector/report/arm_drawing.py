"""Picture of the arm with the measured points and the model's errors there, before and after calibration.

It is seen from the side along which arm and points spread the less of the base's x and y.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.model_versions import Version
from inspector.figures.style import EDGE, Part, figure, scatter
from inspector.figures.svg.figure import svg_of
from inspector.markup.parts.colour_scale import round_limit
from inspector.markup.parts.palette import ARM, BESIDE_COLOURS
from inspector.scene.arm_shape import arm_shape

_SIZE_PX = (850, 350)
_MOST_ERRORS = 120  # that are drawn
_LONGEST_MM = 150.0  # at which the larger errors of the first picture are drawn
_LINK_PX = 7
_UP = 2  # axis of the base


def arm_drawing(before: Version, after: Version, words: tuple[str, str], pose: int) -> str:
    """SVG of the arm at one pose by two models side by side, with errors enlarged equally in both.

    Args:
        before, after: the models, the first the one that is off by more.
        words: names of the errors of each.
        pose: index of the pose that the arm is drawn at.
    """
    views = [_lines(version, pose) for version in (before, after)]
    across = int(np.argmax(np.ptp(np.concatenate(views[0][:2])[:, 0, :2], axis=0)))
    _, errors_mm = views[0]
    large_mm = float(np.percentile(np.linalg.norm(errors_mm[:, 1] - errors_mm[:, 0], axis=1), 90.0))
    factor = max(1.0, round_limit(0.5 * _LONGEST_MM / large_mm)) if large_mm > 0.0 else 1.0
    colours = (BESIDE_COLOURS[1], BESIDE_COLOURS[0])
    traces: list[Part] = []
    for (arm_mm, error_mm), name, colour, number in zip(views, words, colours, ("", "2"), strict=True):
        axes = {"xaxis": f"x{number}", "yaxis": f"y{number}", "connectgaps": False}
        shared = {**axes, "showlegend": not number}
        points_mm, tips_mm = error_mm[:, 0], error_mm[:, 0] + factor * (error_mm[:, 1] - error_mm[:, 0])
        longer = _broken(np.stack([points_mm, tips_mm], axis=1))
        arm = _broken(arm_mm)
        traces += [
            scatter("arm", arm[:, across], arm[:, _UP], line={"color": ARM, "width": _LINK_PX}, more=shared),
            scatter(f"{name}, × {factor:g}", longer[:, across], longer[:, _UP], line={"color": colour}, more=axes),
            scatter(
                "measured point", points_mm[:, across], points_mm[:, _UP], marker={"size": 4, "color": EDGE},
                more=shared,
            ),
        ]  # fmt: skip
    x = {"title": f"{'xy'[across]} of the base, mm", "range": _range(traces, "x")}
    y = {"title": "z, mm", "range": _range(traces, "y"), "constrain": "domain"}
    layout = {"xaxis2": {**x, "domain": [0.54, 1.0]}, "yaxis2": y}
    drawn = figure(traces, xaxis={**x, "domain": [0.0, 0.46]}, yaxis=y, layout=layout)
    return svg_of(drawn, *_SIZE_PX, name="arm", title=f"The arm with the measured points and the errors: {words}")


def _range(traces: Sequence[Part], axis: str) -> list[float]:
    """Range of all values on an axis, with some room on both sides."""
    values = np.array([value for trace in traces for value in trace[axis] if value is not None])
    room = 0.05 * float(np.ptp(values))
    return [float(values.min()) - room, float(values.max()) + room]


def stride(points: int) -> int:
    """Step between drawn points, chosen so that errors do not hide one another."""
    return max(1, -(-points // _MOST_ERRORS))


def _lines(version: Version, pose: int) -> tuple[Array, Array]:
    """Ends (K, 2, 3) of the arm's links and joints, and of errors (M, 2, 3), from measured to predicted, base frame."""
    dataset = version.calibration.dataset
    assert dataset.points is not None
    base_T_scanner = frames.invert(version.scanner_T_base_of_points)
    measured = dataset.points.xyz_mm
    ends = [frames.apply(base_T_scanner, xyz) for xyz in (measured, measured + version.evaluation.error_mm)]
    arm = arm_shape(version.model, version.x, dataset.poses, pose, version.flange_T_scanner(pose))
    return np.stack([arm.start_mm, arm.end_mm], axis=1), np.stack(ends, axis=1)[:: stride(len(measured))]


def _broken(lines_mm: Array) -> Array:
    """Lines (K, 2, 3) one after the other (3 K, 3), with nan between."""
    return np.concatenate([lines_mm, np.full((len(lines_mm), 1, 3), np.nan)], axis=1).reshape(-1, 3)
