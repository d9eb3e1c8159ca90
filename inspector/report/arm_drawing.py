"""Picture of the arm with the measured points and the model's errors there, before and after calibration.

Made without a browser, as SVG: each solid's faces are sorted by depth and drawn from the back to the front. The view is
from the side on which the measured points spread the most, a little from above, without perspective.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.model_versions import Version
from inspector.figures.svg.text import USUAL_PX, escaped, label, number
from inspector.markup.parts.palette import ARM, JOINT, SLIDE
from inspector.scene.arm_shape import ArmShape, arm_shape

WIDTH, HEIGHT = 850, 350
_PANEL = 415.0  # px, the width of one of two
_HEAD, _FOOT = 34.0, 26.0  # px for the words above and below
_SECTORS = 20
_MOST_ARROWS = 120
_ELEVATION_RAD = np.radians(20.0)
_LIGHT = np.array([-0.35, 0.55, 0.75])  # in the picture: right, up, towards the reader
_ARROW_SHARE = 0.25  # of the picture's size, that the larger errors of the first picture take
_BEFORE, _AFTER = "#D55E00", "#0072B2"
_TOOL = "#9AA3AF"


@dataclass(frozen=True)
class _View:
    """A projection along a direction: rows are three unit vectors of the base frame, right, up, towards the reader."""

    axes: Array  # (3, 3)
    middle_mm: Array  # (2,) of what is shown
    px_per_mm: float
    left: float  # px of the panel

    def px(self, points_mm: Array) -> Array:
        """Positions in the picture (N, 2), px, of points (N, 3) in the base frame."""
        flat = (points_mm @ self.axes[:2].T - self.middle_mm) * self.px_per_mm
        height = HEIGHT - _HEAD - _FOOT
        return np.stack([self.left + 0.5 * _PANEL + flat[:, 0], _HEAD + 0.5 * height - flat[:, 1]], axis=1)


@dataclass(frozen=True)
class _Shown:
    """Contents of one picture, in the base frame."""

    arm: ArmShape
    points_mm: Array  # (M, 3)
    errors_mm: Array  # (M, 3) predicted minus measured


def arm_drawing(before: Version, after: Version, words: tuple[str, str], pose: int) -> str:
    """Two pictures side by side of the arm at one pose, with errors enlarged equally in both.

    Args:
        before, after: the models, the first the one that is off by more.
        words: what stands above each picture.
        pose: index of the pose that the arm is drawn at.
    """
    pictures = [_shown(version, pose) for version in (before, after)]
    axes = _axes(pictures[0])
    flat = np.concatenate([_extent_mm(picture) @ axes[:2].T for picture in pictures])
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = np.array([_PANEL - 46.0, HEIGHT - _HEAD - _FOOT - 46.0])  # px, with some left for arrows
    px_per_mm = float((room / np.maximum(high - low, 1.0)).min())
    longer = _round_factor(pictures[0].errors_mm, _ARROW_SHARE * room[1] / px_per_mm)
    above = f'<rect width="{WIDTH}" height="{number(HEIGHT - _FOOT)}"/>'
    out = [f'<defs><clipPath id="arm">{above}</clipPath></defs>']
    for k, (picture, colour) in enumerate(zip(pictures, (_BEFORE, _AFTER), strict=True)):
        view = _View(axes, 0.5 * (low + high), px_per_mm, k * (WIDTH - _PANEL))
        out.append(f'<g clip-path="url(#arm)">{_floor(picture, view)}</g>')
        out.append(_solids(picture.arm, view))
        out.append(_arrows(picture, view, longer, colour))
        out.append(label(words[k], view.left + 0.5 * _PANEL, 14.0, size_px=14.0, css="bold"))
    out.append(_legend(longer, px_per_mm))
    title = f"The arm with the measured points and the errors, {words[0]} and {words[1]}"
    return (
        f'<svg class="plot" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escaped(title)}" '
        f'style="max-width:{WIDTH}px">{"".join(out)}</svg>'
    )


def stride(points: int) -> int:
    """Step between drawn points, chosen so that arrows do not hide one another."""
    return max(1, -(-points // _MOST_ARROWS))


def _shown(version: Version, pose: int) -> _Shown:
    calibration, evaluation = version.calibration, version.evaluation
    dataset = calibration.dataset
    assert dataset.points is not None
    base_T_scanner = frames.invert(version.scanner_T_base_of_points)
    points_mm = frames.apply(base_T_scanner, dataset.points.xyz_mm)
    errors_mm = np.einsum("mij,mj->mi", base_T_scanner[:, :3, :3], evaluation.error_mm)
    every = stride(len(points_mm))
    arm = arm_shape(version.model, version.x, dataset.poses, pose, version.flange_T_scanner(pose))
    return _Shown(arm, points_mm[::every], errors_mm[::every])


def _extent_mm(picture: _Shown) -> Array:
    arm = picture.arm
    return np.concatenate([picture.points_mm, arm.start_mm, arm.end_mm, arm.ball_mm, arm.tip_mm[None]])


def _axes(picture: _Shown) -> Array:
    """View in which the arm and the points extend most horizontally."""
    all_mm = _extent_mm(picture)

    def axes(azimuth: float) -> Array:
        c, s, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(_ELEVATION_RAD), np.sin(_ELEVATION_RAD)
        return np.array([[-s, c, 0.0], [-se * c, -se * s, ce], [ce * c, ce * s, se]])

    views = [axes(azimuth) for azimuth in np.radians(np.arange(0.0, 360.0, 15.0))]
    # Of two opposite views that spread alike, the one with the points in front of the arm.
    nearer = picture.points_mm.mean(axis=0) - picture.arm.start_mm.mean(axis=0)
    return max(views, key=lambda view: float(np.ptp(all_mm @ view[0]) + 0.1 * (nearer @ view[2])))


def _round_factor(errors_mm: Array, longest_mm: float) -> float:
    """Enlargement of 1, 2 or 5 times a power of ten, at least 1, that draws the larger errors at a given length."""
    large_mm = float(np.percentile(np.linalg.norm(errors_mm, axis=1), 90.0)) if len(errors_mm) else 0.0
    if not large_mm > 0.0:
        return 1.0
    wanted = longest_mm / large_mm
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(1.0, next(s * power for s in (5.0, 2.0, 1.0) if s * power <= wanted)))


# ---- solids ---------------------------------------------------------------------------------------------------------


def _solids(arm: ArmShape, view: _View) -> str:
    """SVG faces of cylinders and balls, the farthest first."""
    colours = {"revolute": JOINT, "prismatic": SLIDE, "link": ARM, "tool": _TOOL}
    faces: list[tuple[float, str]] = []
    for start, end, radius, part in zip(arm.start_mm, arm.end_mm, arm.radius_mm, arm.part, strict=True):
        faces += _cylinder(start, end, float(radius), colours[str(part)], view)
    for centre, radius in zip(arm.ball_mm, arm.ball_radius_mm, strict=True):
        faces += _ball(centre, float(radius), view)
    return "".join(face for _, face in sorted(faces, key=lambda face: face[0]))


def _cylinder(start: Array, end: Array, radius: float, colour: str, view: _View) -> list[tuple[float, str]]:
    """Visible faces of a cylinder, with their depths."""
    axis = end - start
    length = float(np.linalg.norm(axis))
    axis = axis / length
    across = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    angle = np.linspace(0.0, 2.0 * np.pi, _SECTORS + 1)
    ring = np.outer(np.cos(angle), across) + np.outer(np.sin(angle), np.cross(axis, across))  # (S + 1, 3) unit
    cuts = np.linspace(0.0, length, max(2, int(np.ceil(length / (2.5 * radius))) + 1))
    faces = []
    for near, far in pairwise(cuts):
        for k in range(_SECTORS):
            normal = ring[k] + ring[k + 1]
            low, high = start + near * axis, start + far * axis
            corners = np.array([low + radius * ring[k], low + radius * ring[k + 1],
                                high + radius * ring[k + 1], high + radius * ring[k]])  # fmt: skip
            faces.append(_face(corners, normal, colour, view))
    for centre, normal in ((start, -axis), (end, axis)):
        faces.append(_face(centre + radius * ring[:-1], normal, colour, view))
    return [face for face in faces if face is not None]


def _ball(centre: Array, radius: float, view: _View) -> list[tuple[float, str]]:
    """Discs that draw a ball, nearer ones smaller and lighter."""
    out = []
    lit = _LIGHT / np.linalg.norm(_LIGHT)
    for k, share in enumerate(np.linspace(1.0, 0.15, 7)):
        shifted = centre + radius * (1.0 - share) * (lit @ view.axes) * 0.6
        (x, y), depth = view.px(shifted[None])[0], float(centre @ view.axes[2]) + 1e-3 * k
        fill = _shaded(ARM, 0.55 + 0.45 * k / 6.0)
        size = number(radius * share * view.px_per_mm)
        out.append((depth, f'<circle cx="{number(x)}" cy="{number(y)}" r="{size}" fill="{fill}"/>'))
    return out


def _face(corners_mm: Array, normal: Array, colour: str, view: _View) -> tuple[float, str] | None:
    """Face (C, 3) with its depth; None where it faces away."""
    seen = view.axes @ (normal / np.linalg.norm(normal))
    if seen[2] <= 0.0:
        return None
    light = 0.50 + 0.55 * max(0.0, float(seen @ _LIGHT) / float(np.linalg.norm(_LIGHT)))
    fill = _shaded(colour, light)
    places = " ".join(f"{number(x)},{number(y)}" for x, y in view.px(corners_mm))
    # A line of the same colour closes the hairline that two faces leave between them.
    return float((corners_mm @ view.axes[2]).mean()), f'<polygon points="{places}" fill="{fill}" stroke="{fill}"/>'


def _shaded(colour: str, light: float) -> str:
    parts = [min(255, round(light * int(colour[k : k + 2], 16))) for k in (1, 3, 5)]
    return "#" + "".join(f"{part:02x}" for part in parts)


# ---- what stands around it ------------------------------------------------------------------------------------------


def _floor(picture: _Shown, view: _View) -> str:
    """Grid at the height of the base's origin."""
    spacing = _grid_mm(view)
    reach = np.ceil(np.abs(_extent_mm(picture)[:, :2]).max() / spacing) * spacing
    lines = np.arange(-reach, reach + 0.5 * spacing, spacing)
    ends = []
    for at in lines:
        ends += [[[at, -reach, 0.0], [at, reach, 0.0]], [[-reach, at, 0.0], [reach, at, 0.0]]]
    left, right = view.left + 4.0, view.left + _PANEL - 4.0
    paths = []
    for line in np.array(ends):
        (x0, y0), (x1, y1) = view.px(line)
        if abs(x1 - x0) > 1e-9:  # cut at the panel's edges
            shares = np.clip((np.array([left, right]) - x0) / (x1 - x0), 0.0, 1.0)
            (x0, x1), (y0, y1) = x0 + shares * (x1 - x0), y0 + shares * (y1 - y0)
        paths.append(f"M{number(x0)} {number(y0)}L{number(x1)} {number(y1)}")
    return f'<path class="grid" d="{"".join(paths)}"/>'


def _grid_mm(view: _View) -> float:
    """Distance of the floor's lines: 1, 2 or 5 times a power of ten, with room between them in the picture."""
    tens = 10.0 ** np.floor(np.log10(28.0 / view.px_per_mm))
    return float(next(mm for mm in tens * np.array([1.0, 2.0, 5.0, 10.0]) if mm * view.px_per_mm > 28.0))


def _arrows(picture: _Shown, view: _View, longer: float, colour: str) -> str:
    starts = view.px(picture.points_mm)
    ends = view.px(picture.points_mm + longer * picture.errors_mm)
    out = []
    for (x0, y0), (x1, y1) in zip(starts, ends, strict=True):
        length = float(np.hypot(x1 - x0, y1 - y0))
        if length > 1.5:
            head = min(6.0, 0.5 * length)
            ux, uy = (x1 - x0) / length, (y1 - y0) / length
            bx, by = x1 - head * ux, y1 - head * uy
            out.append(
                f'<path d="M{number(x0)} {number(y0)}L{number(bx)} {number(by)}" stroke="{colour}" stroke-width="1.5"/>'
                f'<path d="M{number(x1)} {number(y1)}L{number(bx - 0.4 * head * uy)} {number(by + 0.4 * head * ux)}'
                f'L{number(bx + 0.4 * head * uy)} {number(by - 0.4 * head * ux)}z" fill="{colour}"/>'
            )
    dots = [f'<circle cx="{number(x)}" cy="{number(y)}" r="1.9" class="dot"/>' for x, y in starts]
    return "".join([*out, *dots])


def _legend(longer: float, px_per_mm: float) -> str:
    """Legend of dots and arrows, with a scale."""
    y = HEIGHT - 0.5 * _FOOT
    times = f", drawn {longer:g} times longer" if longer != 1.0 else ""
    spacing = _grid_mm(_View(np.eye(3), np.zeros(2), px_per_mm, 0.0))
    scale = spacing * px_per_mm
    right = WIDTH - 12.0
    return "".join(
        (
            f'<circle cx="14" cy="{number(y)}" r="2.4" class="dot"/>',
            label("measured point", 22.0, y, size_px=USUAL_PX, anchor="start"),
            f'<path d="M130 {number(y)}h18" stroke="{_BEFORE}" stroke-width="1.5"/>',
            f'<path d="M152 {number(y)}h18" stroke="{_AFTER}" stroke-width="1.5"/>',
            label(f"where the model puts it{times}", 176.0, y, size_px=USUAL_PX, anchor="start"),
            f'<path class="ruler" d="M{number(right - scale)} {number(y - 4)}v8m0 -4h{number(scale)}m0 -4v8"/>',
            label(f"{spacing:g} mm, as the grid", right - scale - 8.0, y, size_px=USUAL_PX, anchor="end"),
        )
    )
