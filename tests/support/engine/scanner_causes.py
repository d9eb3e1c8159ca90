"""Causes in the instrument or its stand, and causes that time brings about."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.support.engine.cause import Cause
from tests.support.engine.cell import Cell
from tests.support.engine.joint_causes import Rng, carriers, moves
from tests.support.engine.mechanics import Array, Deformation, Posture


def scanner_distortion(cell: Cell, rng: Rng) -> Cause:
    """Depth too long by parts linear and square in depth, or radial by the cube of the way from the middle."""
    seen = cell.seen(cell.plain.point)
    middle = np.append(0.02 * seen[:, 2].mean() * rng.standard_normal(2), seen[:, 2].mean())
    half = np.abs(seen - middle).max()
    share = rng.uniform(0.5, 1.0, 3) * rng.choice([-1.0, 1.0], 3) * (0.2 + 0.8 * np.eye(3)[rng.integers(3)])

    def report(c: Cell, here: Posture, seen: Array, size: float) -> Array:
        u = (seen - middle) / half
        out = share[2] * np.sum(u[:, :2] ** 2, axis=1)[:, None] * u * np.array([1.0, 1.0, 0.0])
        out[:, 2] = share[0] * u[:, 2] + share[1] * u[:, 2] ** 2
        return 0.1 * size * out

    return Cause("scanner_distortion", report=report)


def scanner_drift(cell: Cell, rng: Rng) -> Cause:
    """The tripod sinks and turns at an even rate."""
    seen = cell.seen(cell.plain.point)
    speed, rate = rng.standard_normal(3), rng.standard_normal(3) / np.linalg.norm(seen, axis=1).max()

    def report(c: Cell, here: Posture, seen: Array, size: float) -> Array:
        since = (c.time_s / c.time_s[-1])[:, None]
        return 0.1 * size * since * (speed + np.cross(rate, seen))

    return Cause("scanner_drift", report=report)


def incidence_bias(cell: Cell, rng: Rng) -> Cause:
    """Too far along the ray by the jig's turn away from it."""

    def report(c: Cell, here: Posture, seen: Array, size: float) -> Array:
        ray = seen / np.linalg.norm(seen, axis=1)[:, None]
        axis = np.einsum("nij,nj->ni", c.scanner_T_base[c.setup][:, :3, :3], here.end[-1][:, :3, 2])
        return 0.1 * size * (1.0 - np.abs(np.sum(ray * axis, axis=1)))[:, None] * ray

    return Cause("incidence_bias", report=report)


def _from(cell: Cell, rng: Rng) -> Array:
    """(N,) 0, then 1 from a pose in the middle half on."""
    first = int(rng.integers(cell.poses // 4, 3 * cell.poses // 4))
    return (np.arange(cell.poses) >= first).astype(float)


def joint_step(cell: Cell, rng: Rng) -> Cause:
    """A joint's zero slips at one pose."""
    after = _from(cell, rng)

    def make(shares: Array) -> Cause:
        return moves("joint_step", shares, lambda c, here, j: after)

    return make(carriers(cell, rng, make, np.ones(cell.arm.n), most=1))


def target_step(cell: Cell, rng: Rng) -> Cause:
    """The target is knocked on its tool."""
    after, direction = _from(cell, rng), rng.standard_normal(3)

    def deform(c: Cell, here: Posture, size: float) -> Deformation:
        return replace(c.stiff, tool=0.1 * size * after[:, None] * direction)

    return Cause("target_step", deform)


def scanner_step(cell: Cell, rng: Rng) -> Cause:
    """The scanner is knocked: a rigid step."""
    after, shift = _from(cell, rng), rng.standard_normal(3)
    seen = cell.seen(cell.plain.point)
    turn = rng.standard_normal(3) / np.linalg.norm(seen, axis=1).max()

    def report(c: Cell, here: Posture, seen: Array, size: float) -> Array:
        return 0.1 * size * after[:, None] * (shift + np.cross(turn, seen))

    return Cause("scanner_step", report=report)


def warm_up(cell: Cell, rng: Rng) -> Cause:
    """Lengths grow towards their value in working warmth, nobody reads a thermometer."""
    settling = cell.time_s[-1] * rng.uniform(0.12, 0.4)

    def deform(c: Cell, here: Posture, size: float) -> Deformation:
        return replace(c.stiff, growth=1e-4 * size * (1.0 - np.exp(-c.time_s / settling)))

    return Cause("warm_up", deform)
