"""Causes that stand in no catalogue."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.support.engine.cause import Cause
from tests.support.engine.cell import Cell
from tests.support.engine.joint_causes import Rng, carriers, moves
from tests.support.engine.load_causes import down_in_tool
from tests.support.engine.mechanics import Array, Deformation, Posture


def _one_joint(name: str, law: Callable[[Cell, Posture, int], Array], cell: Cell, rng: Rng) -> Cause:
    def make(shares: Array) -> Cause:
        return moves(name, shares, law)

    return make(carriers(cell, rng, make, cell.turns, most=1))


def root_of_angle(cell: Cell, rng: Rng) -> Cause:
    """A joint errs with the root of its angle from the end of its range."""
    return _one_joint("root_of_angle", lambda c, here, j: np.sqrt(c.q[:, j] - c.q[:, j].min()), cell, rng)


def creeping_joint(cell: Cell, rng: Rng) -> Cause:
    """A joint goes on giving way to the load of the last minutes."""
    settling = rng.uniform(90.0, 300.0)

    def crept(c: Cell, here: Posture, j: int) -> Array:
        load = c.plain.load(j, False)
        out, state = np.zeros(c.poses), load[0]
        for k in range(1, c.poses):
            state += (load[k - 1] - state) * (1.0 - np.exp(-(c.time_s[k] - c.time_s[k - 1]) / settling))
            out[k] = state
        return out / max(np.abs(load).max(), 1e-9)

    return _one_joint("creeping_joint", crept, cell, rng)


def steep_coupling(cell: Cell, rng: Rng) -> Cause:
    """A joint that one of its neighbours turns along from one stop to the other, as it passes through its zero."""

    def law(c: Cell, here: Posture, j: int) -> Array:
        return np.tanh(5.0 * c.q[:, j + 1])

    turns = np.append(cell.turns[:-1] & cell.turns[1:], False)
    return moves("steep_coupling", np.sign(carriers(cell, rng, lambda s: moves("", s, law), turns, most=1)), law)


def product_of_joints(cell: Cell, rng: Rng) -> Cause:
    """A joint errs with the product of its angle and another's."""
    first, second = rng.permutation(np.flatnonzero(cell.turns))[:2]

    def product(c: Cell, here: Posture, j: int) -> Array:
        return c.q[:, j] * c.q[:, second if j == first else first]

    return _one_joint("product_of_joints", product, cell, rng)


def loose_tool(cell: Cell, rng: Rng) -> Cause:
    """A tool falls over into its play once it leans beyond an angle."""
    limit, direction = rng.uniform(-0.4, 0.4), rng.standard_normal(3)

    def deform(c: Cell, here: Posture, size: float) -> Deformation:
        over = down_in_tool(c, here)[:, 2] > limit
        return replace(c.stiff, tool=0.1 * size * over[:, None] * direction)

    return Cause("loose_tool", deform)


def swinging_payload(cell: Cell, rng: Rng) -> Cause:
    """A payload still swings towards where it came from, in proportion to its weight."""

    def deform(c: Cell, here: Posture, size: float) -> Deformation:
        way = np.diff(here.point, axis=0, prepend=here.point[:1])
        way = way / np.maximum(np.linalg.norm(way, axis=1), 1.0)[:, None]
        hanging = (c.payload_kg + c.arm.tool_kg) / (max(c.arm.payloads_kg) + c.arm.tool_kg)
        return replace(c.stiff, target=0.1 * size * hanging[:, None] * way)

    return Cause("swinging_payload", deform)


def refraction(cell: Cell, rng: Rng) -> Cause:
    """Warm air bends the line of sight upwards, by the square of the distance, more above than below."""

    def report(c: Cell, here: Posture, seen: Array, size: float) -> Array:
        far = (np.linalg.norm(seen, axis=1) / np.linalg.norm(seen, axis=1).mean()) ** 2
        up = -np.array(c.arm.gravity) / np.linalg.norm(c.arm.gravity)
        ups = np.einsum("nij,j->ni", c.scanner_T_base[c.setup][:, :3, :3], up)
        height = np.sum(ups * seen, axis=1)
        warm = np.exp(-(height - height.min()) / max(np.ptp(height), 1.0) * 2.0)
        return 0.1 * size * (far * warm)[:, None] * ups

    return Cause("refraction", report=report)


def late_clock(cell: Cell, rng: Rng) -> Cause:
    """The tracker's clock is late by a time that itself wanders: every joint is still on its way."""
    lag = 1.0 + np.cumsum(rng.standard_normal(cell.poses)) / np.sqrt(cell.poses)

    def deform(c: Cell, here: Posture, size: float) -> Deformation:
        way = np.diff(c.q, axis=0, prepend=c.q[:1])
        return replace(c.stiff, joint=-1e-4 * size * lag[:, None] * np.sign(way))

    return Cause("late_clock", deform)


def hose_pull(cell: Cell, rng: Rng) -> Cause:
    """A hose from a point above to the middle link pulls two joints."""
    reach = cell.arm.reach_mm
    anchor = 0.6 * reach * np.array([*rng.uniform(-1.0, 1.0, 2), rng.choice([-1.0, 1.0])])
    link = cell.arm.n // 2

    def pulled(c: Cell, here: Posture, j: int) -> Array:
        held = here.end[link][:, :3, 3]
        rope = anchor - held
        length = np.linalg.norm(rope, axis=1)
        force = np.maximum(length / reach - 0.3, 0.0)[:, None] * rope / length[:, None]
        lever = (held - here.carrier[j][:, :3, 3]) / reach
        return 5.0 * np.einsum("ni,ni->n", here.carrier[j][:, :3, 2], np.cross(lever, force))

    return moves("hose_pull", np.where((np.arange(cell.arm.n) <= link) & cell.turns, 1.0, 0.0), pulled)


def swaying_tripod(cell: Cell, rng: Rng) -> Cause:
    """The scanner's stand sways with the heating of the hall, every 20 to 40 minutes."""
    period, phase = rng.uniform(1200.0, 2400.0), rng.uniform(0, 2 * np.pi)
    shift = rng.standard_normal(3)

    def report(c: Cell, here: Posture, seen: Array, size: float) -> Array:
        return 0.1 * size * np.sin(2 * np.pi * c.time_s / period + phase)[:, None] * shift

    return Cause("swaying_tripod", report=report)


def cyclic_range_error(cell: Cell, rng: Rng) -> Cause:
    """A distance meter errs along the ray, periodic in the distance."""
    wave = rng.uniform(80.0, 400.0)
    phase = rng.uniform(0, 2 * np.pi)

    def report(c: Cell, here: Posture, seen: Array, size: float) -> Array:
        far = np.linalg.norm(seen, axis=1)[:, None]
        return 0.1 * size * np.sin(2 * np.pi * far / wave + phase) * seen / far

    return Cause("cyclic_range_error", report=report)


def creeping_tool(cell: Cell, rng: Rng) -> Cause:
    """A target's glue gives way under its weight, ever more slowly."""
    direction, settling = rng.standard_normal(3), cell.time_s[-1] * rng.uniform(0.2, 0.5)

    def deform(c: Cell, here: Posture, size: float) -> Deformation:
        crept = 1.0 - np.exp(-c.time_s / settling)
        return replace(c.stiff, tool=0.1 * size * crept[:, None] * direction)

    return Cause("creeping_tool", deform)


def unwritten_backlash(cell: Cell, rng: Rng) -> Cause:
    """Play to the side of the last motion, where nobody wrote down the side."""

    def side(c: Cell, here: Posture, j: int) -> Array:
        return np.sign(np.diff(c.q[:, j], prepend=c.q[0, j] - 1.0))

    return _one_joint("unwritten_backlash", side, cell, rng)


def cracked_floor(cell: Cell, rng: Rng) -> Cause:
    """The foot tips when the arm's weight goes over an edge."""
    edge, turn = rng.standard_normal(2), np.append(rng.standard_normal(2), 0.0)

    def deform(c: Cell, here: Posture, size: float) -> Deformation:
        over = here.moment(np.zeros((c.poses, 3)), 0)[:, :2] @ edge
        plain = c.plain.moment(np.zeros((c.poses, 3)), 0)[:, :2] @ edge
        tips = 1.0 / (1.0 + np.exp(-12.0 * (over - np.median(plain)) / max(np.std(plain), 1e-9)))
        return replace(c.stiff, base_turn=1e-4 * size * tips[:, None] * turn)

    return Cause("cracked_floor", deform)
