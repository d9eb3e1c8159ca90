"""The arm at one pose as it is meant and with an effect, much enlarged; beside it what becomes of the target."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from effect_drawing import AFTER, BEFORE, PANEL, WIDTH, arrow, dots, number, svg, text
from effect_signatures import Signature, Standard

from calib import frames
from calib.array_types import Array
from calib.effects.effect import is_linear
from calib.fitting.model import Model
from inspector.scene.arm_shape import ArmShape, arm_shape

_ELEVATION_RAD = np.radians(14.0)
_MOVED = 0.2  # of the reach, that the target moves in the drawing
_MOST_TURN_RAD = 0.9  # in the drawing
_ARROWS = 70
ARM, TARGET, REPORT = "arm", "target", "report"


@dataclass(frozen=True)
class _View:
    axes: Array  # (3, 3) right, up, towards the reader
    middle_mm: Array  # (2,)
    px_per_mm: float
    left: float
    height: float

    def px(self, points_mm: Array) -> Array:
        flat = (np.atleast_2d(points_mm) @ self.axes[:2].T - self.middle_mm) * self.px_per_mm
        return np.stack([self.left + 0.5 * PANEL + flat[:, 0], 0.5 * self.height + 16.0 - flat[:, 1]], axis=1)


def arm_picture(signature: Signature, standard: Standard) -> str:
    """The arm at one pose as it is meant and with the effect, much enlarged; beside it the target at many poses."""
    height = 320.0
    poses = standard.state.poses
    robot = standard.state.robot
    base_R_scanner = np.swapaxes(standard.scanner_T_base[:, :3, :3], 1, 2)
    before, after = (np.einsum("mij,mj->mi", base_R_scanner, v) for v in (signature.before_mm, signature.after_mm))
    target_mm = standard.state.place(standard.state.chain.target_mm)
    pose, axes = _pose_and_view(before, target_mm)
    factor = _factor(signature, standard, pose, before)
    moves = _what_moves(signature, standard)
    model = Model(robot, (signature.member,))
    values = factor * signature.values
    plain, moved = (arm_shape(model, x, poses, pose) for x in (0.0 * values, values))
    if moves != ARM:
        moved = plain
    there = moved.tip_mm if moves == ARM else plain.tip_mm + factor * before[pose]
    seen = np.concatenate([plain.start_mm, plain.end_mm, moved.start_mm, moved.end_mm, there[None], np.zeros((1, 3))])
    view = _fitted(seen, axes, 0.0, height)
    joint = getattr(signature.member, "joint", None)
    out = [_ground(view, seen)]
    out += [_arm(plain, view, "currentColor", 0.30)]
    if moves == ARM:
        out += [_arm(moved, view, BEFORE, 0.75, joint)]
    elif moves == REPORT:
        out.append(_sight(view, there, standard.scanner_T_base[pose]))
    out.append(arrow(view.px(plain.tip_mm)[0], view.px(there)[0], BEFORE, 2.4))
    out.append(text(f"one pose, {factor:,.0f} times enlarged", 6.0, 14.0))
    out.append(text("as meant", 6.0, 31.0, extra=' fill-opacity=".6"'))
    out.append(text("with the effect", 72.0, 31.0, extra=f' fill="{BEFORE}" font-weight="600"'))
    out.append(_field(target_mm, before, after, axes, height))
    what = {
        ARM: "the arm moves",
        TARGET: "the arm stays as it is, the target moves on it",
        REPORT: "the arm stays as it is, what the scanner reports moves",
    }[moves]
    words = (
        f"Left: the arm {robot.name} at one pose, as it is meant and with {signature.family}, enlarged {factor:,.0f} "
        f"times; {what}. Right: the target at {min(_ARROWS, len(target_mm))} poses, with arrows of how the effect "
        "moves it and of what a fit of the links leaves of that."
    )
    return svg("".join(out), WIDTH, height, words)


def _what_moves(signature: Signature, standard: Standard) -> str:
    """The arm, the target on it alone, or only what the scanner reports."""
    named = {p.name: float(v) for p, v in zip(signature.member.parameters, signature.values, strict=True)}
    blind = replace(standard.state, seen=None)
    after = signature.member.apply(blind, **named)
    if np.array_equal(np.broadcast_to(blind.vector, after.vector.shape), after.vector):
        return REPORT
    still = np.array_equal(np.broadcast_to(blind.table, after.table.shape), after.table)
    return TARGET if still and not np.any(after.base_rotvec_rad) else ARM


def _pose_and_view(moved_mm: Array, target_mm: Array) -> tuple[int, Array]:
    """A pose that the effect moves much, seen from the side on which that and the arm spread."""
    size = np.linalg.norm(moved_mm, axis=1)
    best: tuple[float, int, Array] = (-np.inf, 0, np.eye(3))
    for azimuth in np.radians(np.arange(0.0, 360.0, 15.0)):
        c, s, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(_ELEVATION_RAD), np.sin(_ELEVATION_RAD)
        axes = np.array([[-s, c, 0.0], [-se * c, -se * s, ce], [ce * c, ce * s, se]])
        across = np.linalg.norm(moved_mm @ axes[:2].T, axis=1) / max(float(size.max()), 1e-300)
        reach = np.abs(target_mm @ axes[0]) / float(np.abs(target_mm).max())
        worth = across + reach - 2.0 * (target_mm[:, 2] < 150.0)
        pose = int(np.argmax(worth))
        if worth[pose] > best[0]:
            best = (float(worth[pose]), pose, axes)
    return best[1], best[2]


def _factor(signature: Signature, standard: Standard, pose: int, moved_mm: Array) -> float:
    """1, 2 or 5 times a power of ten, by which the effect is enlarged so that it can be seen at this pose."""
    reach = float(np.linalg.norm(standard.state.chain.target_mm, axis=1).max())
    wanted = _MOVED * reach / max(float(np.linalg.norm(moved_mm[pose])), 1e-9)
    if is_linear(signature.member):
        named = {p.name: float(v) for p, v in zip(signature.member.parameters, signature.values, strict=True)}
        after = signature.member.apply(standard.state, **named)
        change = np.abs(np.broadcast_to(after.table, (len(moved_mm), *after.table.shape[1:]))[pose]
                        - standard.state.table[0])[:, [1, 3, 4]].max()  # fmt: skip
        change = max(float(change), float(np.abs(after.base_rotvec_rad).max()))
        wanted = min(wanted, _MOST_TURN_RAD / max(change, 1e-12))
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(next(s * power for s in (5.0, 2.0, 1.0) if s * power <= wanted))


def _fitted(points_mm: Array, axes: Array, left: float, height: float) -> _View:
    flat = points_mm @ axes[:2].T
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = np.array([PANEL - 60.0, height - 96.0])
    return _View(axes, 0.5 * (low + high), float((room / np.maximum(high - low, 1.0)).min()), left, height)


def _arm(arm: ArmShape, view: _View, colour: str, opacity: float, joint: int | None = None) -> str:
    """Each solid as a stroke, those farther away first; the joint that carries the effect has a ring."""
    strokes = []
    for start, end, radius, part, link in zip(arm.start_mm, arm.end_mm, arm.radius_mm, arm.part, arm.link, strict=True):
        (x0, y0), (x1, y1) = view.px(np.stack([start, end]))
        depth = float(0.5 * (start + end) @ view.axes[2])
        is_joint = str(part) not in ("link", "tool")
        width = max(2.0 * radius * view.px_per_mm, 2.0)
        cap = "butt" if is_joint else "round"
        line = f"M{number(x0)} {number(y0)}L{number(x1)} {number(y1)}"
        stroke = f'<path d="{line}" stroke-width="{number(width)}" stroke-linecap="{cap}"/>'
        strokes.append((depth, stroke))
        if is_joint and joint is not None and int(link) == joint:
            mx, my = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
            place = f'cx="{number(mx)}" cy="{number(my)}" r="{number(0.9 * width)}"'
            strokes.append((np.inf, f'<circle {place} fill="none" stroke-width="2"/>'))
    body = "".join(stroke for _, stroke in sorted(strokes, key=lambda one: one[0]))
    return f'<g stroke="{colour}" opacity="{opacity:g}" fill="none">{body}</g>'


def _ground(view: _View, seen_mm: Array) -> str:
    x, y = view.px(np.zeros(3))[0]
    half = 46.0
    hatch = "".join(f"M{number(x + k)} {number(y)}l-7 8" for k in np.arange(-half + 8.0, half + 1.0, 12.0))
    line = f"M{number(x - half)} {number(y)}H{number(x + half)}"
    return f'<path d="{line}{hatch}" stroke="currentColor" stroke-opacity=".5" fill="none"/>'


def _sight(view: _View, at_mm: Array, scanner_T_base: Array) -> str:
    """The line of sight from what is reported towards the scanner, and a box for it, not where it stands."""
    way = view.axes[:2] @ (frames.invert(scanner_T_base)[:3, 3] - at_mm)
    way /= max(float(np.linalg.norm(way)), 1e-9)
    x, y = view.px(at_mm)[0]
    free = [
        ((view.left + PANEL - 34.0 if way[0] > 0 else view.left + 34.0) - x) / way[0] if abs(way[0]) > 1e-6 else 1e9,
        ((52.0 if way[1] > 0 else view.height - 30.0) - y) / -way[1] if abs(way[1]) > 1e-6 else 1e9,
    ]
    length = float(np.clip(min([f for f in free if f > 0] or [40.0]), 30.0, 120.0))
    x1, y1 = x + length * way[0], y - length * way[1]
    side = 1.0 if x1 < view.left + 0.5 * PANEL else -1.0  # of the box on which there is room for words
    line = f"M{number(x)} {number(y)}L{number(x1)} {number(y1)}"
    return (
        f'<path d="{line}" stroke="currentColor" stroke-dasharray="4 4" fill="none"/>'
        f'<rect x="{number(x1 - 13)}" y="{number(y1 - 8)}" width="26" height="16" rx="3" fill="currentColor"/>'
        + text("to the scanner", x1 + side * 19.0, y1 + 4.0, anchor="start" if side > 0 else "end")
    )


def _field(target_mm: Array, before_mm: Array, after_mm: Array, axes: Array, height: float) -> str:
    """The target at some poses, with both arrows, enlarged by one factor."""
    some = np.unique(np.linspace(0, len(target_mm) - 1, _ARROWS).astype(int))
    sizes = np.linalg.norm(before_mm[some], axis=1)
    size = max(float(np.percentile(sizes, 90.0)), 0.5 * float(sizes.max()))
    reach = float(np.ptp(target_mm @ axes[:2].T, axis=0).max())
    longer = 0.13 * reach / max(size, 1e-9)
    ends = np.concatenate([target_mm[some], target_mm[some] + longer * before_mm[some]])
    view = _fitted(ends, axes, WIDTH - PANEL, height)
    starts = view.px(target_mm[some])
    out = []
    for moved, colour, width in ((before_mm, BEFORE, 1.3), (after_mm, AFTER, 1.6)):
        ends = view.px(target_mm[some] + longer * moved[some])
        out += [arrow(a, b, colour, width) for a, b in zip(starts, ends, strict=True)]
    out.append(f'<path d="{dots(starts[:, 0], starts[:, 1], 1.7)}" fill="currentColor" fill-opacity=".7"/>')
    left = WIDTH - PANEL + 6.0
    out.append(text(f"the target at {len(some)} poses", left, 14.0))
    out.append(text("moved by the effect", left, 31.0, extra=f' fill="{BEFORE}" font-weight="600"'))
    out.append(text("what a fit of the links leaves", left + 150.0, 31.0, extra=f' fill="{AFTER}" font-weight="600"'))
    return "".join(out)
