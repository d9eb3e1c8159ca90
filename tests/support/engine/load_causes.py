"""Causes that weight brings about: joints, links, bearings, base and tool that give way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.support.engine.cause import Cause
from tests.support.engine.cell import Cell
from tests.support.engine.joint_causes import Rng, carriers, moves
from tests.support.engine.mechanics import Array, Deformation, Posture

STATIONS = 12
"""Along a rod."""


def _load(cell: Cell, here: Posture, joint: int) -> Array:
    """(N,) torque about a joint over its largest in all poses without any cause."""
    largest = np.abs(cell.plain.load(joint, cell.arm.slides[joint])).max()
    return here.load(joint, cell.arm.slides[joint]) / max(largest, 1e-9)


def _loaded(cell: Cell) -> Array:
    """(n,) joints that turn and feel more than 2 % of the strongest torque."""
    peak = np.array([np.abs(cell.plain.load(j, False)).max() if turns else 0.0 for j, turns in enumerate(cell.turns)])
    return peak > 0.02 * max(float(peak.max()), 1e-9)


def _by_load(name: str, law: Callable[[Array], Array], *, most: int | None = None):
    def draw(cell: Cell, rng: Rng) -> Cause:
        def make(shares: Array) -> Cause:
            return moves(name, shares, lambda c, here, j: law(_load(c, here, j)))

        return make(carriers(cell, rng, make, _loaded(cell), most=most, signed=False))

    return draw


joint_compliance = _by_load("joint_compliance", lambda load: load)
gravity_backlash = _by_load("gravity_backlash", np.sign)
nonlinear_stiffness = _by_load("nonlinear_stiffness", lambda load: load * np.abs(load), most=2)
saturating_spring = _by_load("saturating_spring", lambda load: np.tanh(5.0 * load), most=1)


def _rods(cell: Cell) -> Array:
    """(n,) lengths, mm, of links; those that slide count as stiff."""
    rows = np.array(cell.arm.rows[:-1])
    return np.hypot(rows[:, 0], rows[:, 2]) * cell.turns


def _across(moment: Array, axis: Array) -> Array:
    return moment - np.einsum("ni,ni->n", moment, axis)[:, None] * axis


def link_bending(cell: Cell, rng: Rng) -> Cause:
    """Rods clamped at the joint: curvature at each station by the moment there, summed up along the rod."""
    n = cell.arm.n
    length = _rods(cell)

    def make(shares: Array) -> Cause:
        def deform(c: Cell, here: Posture, size: float) -> Deformation:
            turn, shift = np.zeros((c.poses, n, 3)), np.zeros((c.poses, n, 3))
            for j in np.flatnonzero(shares):
                by_axes, by_shift = bent_rod(c, here, int(j))
                turn[:, j] = size * 1e-6 * shares[j] * by_axes
                shift[:, j] = size * 1e-6 * shares[j] * by_shift
            return replace(c.stiff, turn=turn, shift=shift)

        return Cause("link_bending", deform)

    return make(carriers(cell, rng, make, length > 100.0, signed=False))


def bent_rod(cell: Cell, here: Posture, j: int) -> tuple[Array, Array]:
    """Turn (N, 3) and shift (N, 3) mm of link j's end in the link's frame, with L / EI = 1 rad / N m."""
    start, stop = here.carrier[j][:, :3, 3], here.end[j][:, :3, 3]
    span = stop - start
    length = np.linalg.norm(span, axis=1)[:, None]
    axis = span / length
    weight = (cell.arm.mass_kg or ())[j] * np.array(cell.arm.gravity)
    turn, shift = np.zeros_like(span), np.zeros_like(span)
    for k in range(STATIONS):
        s = (k + 0.5) / STATIONS
        beyond = here.moment(start + s * span, j + 1)
        own = np.cross(0.5 * (1.0 - s) * span / 1000.0, (1.0 - s) * weight)
        curve = _across(beyond + own, axis) / STATIONS
        turn = turn + curve
        shift = shift + np.cross(curve, (1.0 - s) * span)
    to_link = here.end[j][:, :3, :3]
    return np.einsum("nji,nj->ni", to_link, turn), np.einsum("nji,nj->ni", to_link, shift)


def link_torsion(cell: Cell, rng: Rng) -> Cause:
    """A rod twisted about its own length by the moment at its end; not where that is the next joint's axis."""
    n = cell.arm.n
    rows = np.array(cell.arm.rows[:-1])
    apart = np.abs(rows[:, 0]) > 100.0  # else its length is the joint's own axis, and torsion its compliance

    def make(shares: Array) -> Cause:
        def deform(c: Cell, here: Posture, size: float) -> Deformation:
            turn = np.zeros((c.poses, n, 3))
            for j in np.flatnonzero(shares):
                start, stop = here.carrier[j][:, :3, 3], here.end[j][:, :3, 3]
                axis = (stop - start) / np.linalg.norm(stop - start, axis=1)[:, None]
                twist = np.einsum("ni,ni->n", here.moment(stop, int(j) + 1), axis)[:, None] * axis
                local = np.einsum("nji,nj->ni", here.end[j][:, :3, :3], twist)
                turn[:, j] = size * 1e-6 * shares[j] * local
            return replace(c.stiff, turn=turn)

        return Cause("link_torsion", deform)

    return make(carriers(cell, rng, make, apart & cell.turns, most=1, signed=False))


def bearing_clearance(cell: Cell, rng: Rng) -> Cause:
    """An axis leans by a fixed angle about the moment across it."""
    n = cell.arm.n

    def make(shares: Array) -> Cause:
        def deform(c: Cell, here: Posture, size: float) -> Deformation:
            tilt = np.zeros((c.poses, n, 3))
            for j in np.flatnonzero(shares):
                frame = here.carrier[j]
                side = _across(here.moment(frame[:, :3, 3], int(j)), frame[:, :3, 2])
                side = side / np.maximum(np.linalg.norm(side, axis=1), 1e-9)[:, None]
                tilt[:, j] = size * 1e-4 * shares[j] * np.einsum("nji,nj->ni", frame[:, :3, :3], side)
            return replace(c.stiff, tilt=tilt)

        return Cause("bearing_clearance", deform)

    return make(carriers(cell, rng, make, cell.turns, most=1, signed=False))


def _tilting_base(name: str, share: Callable[[Cell], Array], soft: Array) -> Cause:
    def deform(c: Cell, here: Posture, size: float) -> Deformation:
        moment = here.moment(np.zeros((c.poses, 3)), 0)
        return replace(c.stiff, base_turn=size * 1e-6 * soft * moment * share(c)[:, None])

    return Cause(name, deform)


def base_compliance(cell: Cell, rng: Rng) -> Cause:
    """The foot tilts under the whole arm's moment, about x and y."""
    soft = np.array([*rng.uniform(0.5, 1.5, 2), 0.0])
    return _tilting_base("base_compliance", lambda c: np.ones(c.poses), soft)


def base_loosening(cell: Cell, rng: Rng) -> Cause:
    """A tilt of the foot under the arm's moment, from one pose on."""
    first = int(rng.integers(cell.poses // 4, 3 * cell.poses // 4))
    soft = np.array([*rng.uniform(0.5, 1.5, 2), 0.0])
    return _tilting_base("base_loosening", lambda c: (np.arange(c.poses) >= first).astype(float), soft)


def down_in_tool(cell: Cell, here: Posture) -> Array:
    """(N, 3) gravity's direction in the last link's frame."""
    down = np.array(cell.arm.gravity) / np.linalg.norm(cell.arm.gravity)
    return np.einsum("nji,j->ni", here.end[-1][:, :3, :3], down)


def tool_sag(cell: Cell, rng: Rng) -> Cause:
    """A tool that yields to its own weight, differently along its three axes."""
    soft = rng.uniform(0.4, 1.6, 3) * np.array([1.0, 1.0, 0.3])[rng.permutation(3)]

    def deform(c: Cell, here: Posture, size: float) -> Deformation:
        return replace(c.stiff, tool=0.05 * size * soft * down_in_tool(c, here))

    return Cause("tool_sag", deform)


def thermal_growth(cell: Cell, rng: Rng) -> Cause:
    """All lengths grow with the temperature that is written down."""

    def deform(c: Cell, here: Posture, size: float) -> Deformation:
        return replace(c.stiff, growth=size * 1e-5 * (c.temperature_c - 20.0))

    return Cause("thermal_growth", deform)
