"""A cell: a true arm before a scanner, its poses and conditions, and how much of a displacement geometry leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tests.support.engine.arms import ArmTable
from tests.support.engine.cause import Cause
from tests.support.engine.mechanics import Array, Deformation, Posture, at_rest, posture, turned

TARGETS = {"A": (60.0, 25.0, 40.0), "B": (-45.0, 50.0, 65.0)}
"""Further targets on the tool, in the last link's frame, mm."""


@dataclass(frozen=True, eq=False)
class Cell:
    """An arm that errs in its lengths and angles, N poses, and the scanner's placements."""

    arm: ArmTable  # nominal
    rows: Array  # (n + 1, 5) true
    q: Array  # (N, n) commanded
    payload_kg: Array  # (N,)
    temperature_c: Array  # (N,)
    time_s: Array  # (N,)
    approach: Array  # (N, n) -1, 1
    setup: NDArray[np.int64]  # (N,)
    scanner_T_base: Array  # (S, 4, 4)
    targets: tuple[str, ...] = ()
    mass_factor: Array = field(default_factory=lambda: np.ones(0))  # (n,) true masses over the nominal

    @property
    def poses(self) -> int:
        return len(self.q)

    @property
    def turns(self) -> NDArray[np.bool_]:
        """(n,) joints that turn."""
        return ~np.array(self.arm.slides)

    @cached_property
    def weights(self) -> list[tuple[int, Array, Array]]:
        """Links, tool and payload: link, force (N, 3), centre (3,)."""
        arm, down = self.arm, np.array(self.arm.gravity)
        factor = self.mass_factor if len(self.mass_factor) else np.ones(arm.n)
        out = []
        for j, (mass, centre) in enumerate(zip(arm.mass_kg or (), arm.com_mm, strict=True)):
            out.append((j, np.tile(mass * factor[j] * down, (self.poses, 1)), np.array(centre)))
        hung = ((np.full(self.poses, arm.tool_kg), arm.tool_com_mm), (self.payload_kg, arm.payload_com_mm))
        for mass_kg, centre in hung:
            out.append((arm.n, mass_kg[:, None] * down, np.array(centre)))
        return out

    @cached_property
    def stiff(self) -> Deformation:
        """Nothing gives way."""
        return Deformation.none(self.poses, self.arm.n)

    def pose(self, bent: Deformation) -> Posture:
        """The true arm, displaced by `bent`."""
        return posture(self.rows, self.arm.slides, self.q, bent, self.weights)

    @cached_property
    def plain(self) -> Posture:
        """The arm without any cause."""
        return self.pose(self.stiff)

    def posed(self, causes: Sequence[tuple[Cause, float]]) -> Posture:
        """The arm with its causes, each with a size."""
        moving = [(c, size) for c, size in causes if c.deform is not None]
        if not moving:
            return self.plain

        def give(here: Posture) -> Deformation:
            total = self.stiff
            for cause, size in moving:
                total = total + cause.deform(self, here, size)
            return total

        return at_rest(self.pose, give, give(self.plain))

    def seen(self, point: Array) -> Array:
        """(N, 3) points of the base in the frame of each pose's scanner."""
        frame = self.scanner_T_base[self.setup]
        return np.einsum("nij,nj->ni", frame[:, :3, :3], point) + frame[:, :3, 3]

    def reported(self, causes: Sequence[tuple[Cause, float]]) -> dict[str, Array]:
        """Points (N, 3) of each target as the scanner reports them, without noise; the tool point is "jig"."""
        here = self.posed(causes)
        points = {"jig": here.point, **{name: here.on_tool(np.array(TARGETS[name])) for name in self.targets}}
        out = {}
        for name, point in points.items():
            seen = self.seen(point)
            for cause, size in causes:
                if cause.report is not None:
                    seen = seen + cause.report(self, here, self.seen(point), size)
            out[name] = seen
        return out

    @cached_property
    def geometry(self) -> Array:
        """(3 N, K) orthonormal: all that link errors and the scanner's placements can do to the tool points."""
        nominal = self.seen(self.plain.point)
        columns = []
        for row in range(self.arm.n + 1):
            for kind in range(5):
                step = 1e-2 if kind in (0, 2) else 1e-5
                rows = self.rows.copy()
                rows[row, kind] += step
                moved = posture(rows, self.arm.slides, self.q, self.stiff).point
                columns.append((self.seen(moved) - nominal).ravel() / step * (1.0 if step > 1e-3 else 1e-3))
        for place in range(len(self.scanner_T_base)):
            here = (self.setup == place)[:, None]
            for axis in np.eye(3):
                columns.append((here * axis).ravel())
                columns.append((here * np.cross(axis, 1e-3 * nominal)).ravel())
        left, size, _ = np.linalg.svd(np.column_stack(columns), full_matrices=False)
        return left[:, size > 1e-4 * size[0]]

    def visible_mm(self, causes: Sequence[tuple[Cause, float]]) -> float:
        """Root mean square a coordinate of the tool points' displacement that no geometry imitates."""
        shift = (self.reported(causes)["jig"] - self.seen(self.plain.point)).ravel()
        left = shift - self.geometry @ (self.geometry.T @ shift)
        return float(np.sqrt(np.mean(left**2)))

    def size_for(self, cause: Cause, visible_mm: float) -> float:
        """The size at which a cause is visible by so much; nan where it cannot be made so."""
        size = 1.0
        for _ in range(3):
            found = self.visible_mm([(cause, size)])
            if not np.isfinite(found) or found < 1e-7:
                return float("nan")
            size *= visible_mm / found
        return size


def draw_cell(
    arm: ArmTable,
    rng: np.random.Generator,
    *,
    poses: int = 80,
    setups: int = 1,
    targets: int = 0,
    payload: bool = True,
    paced: bool | None = None,
    near: bool = False,
) -> Cell:
    """An arm with errors of 0.4 mm and 1.4 mrad, its scanner two reaches away or `near`, and joints drawn at random.

    paced: joints come from the side of the pose before; else from a side that was chosen. None: drawn.
    """
    n, reach = arm.n, arm.reach_mm
    spread = np.array([0.4, 1.4e-3, 0.4, 1.4e-3, 1.4e-3])
    rows = np.array(arm.rows) + spread * rng.standard_normal((n + 1, 5))
    q = _joints_before_scanner(arm, rng, poses)
    point = posture(np.array(arm.rows), arm.slides, q, Deformation.none(poses, n)).point
    frames = np.array([_scanner(point, reach * (0.5 if near else 1.0), rng) for _ in range(setups)])
    time_s = np.round(np.cumsum(np.append(0.0, rng.uniform(20.0, 70.0, poses - 1))), 1)
    before = np.vstack([q[0] - (q[-1] - q[0]), q[:-1]])
    paced = bool(rng.random() < 0.5) if paced is None else paced
    side = np.where(q >= before, 1.0, -1.0) if paced else rng.choice([-1.0, 1.0], (poses, n))
    load = rng.choice(np.array(arm.payloads_kg), poses) if payload else np.zeros(poses)
    return Cell(
        arm=arm,
        rows=rows,
        q=q,
        payload_kg=load,
        temperature_c=_temperatures(time_s, rng),
        time_s=time_s,
        approach=side,
        setup=np.sort(rng.permutation(np.arange(poses) % setups)),
        scanner_T_base=frames,
        targets=tuple(list(TARGETS)[:targets]),
    )


def _joints_before_scanner(arm: ArmTable, rng: np.random.Generator, poses: int) -> Array:
    """(N, n) joints within their limits, the tool point in the half of the room where the scanner stands."""
    low, high = np.array(arm.low), np.array(arm.high)
    kept: list[Array] = []
    side = None
    while sum(map(len, kept)) < poses:
        q = rng.uniform(low, high, (6 * poses, arm.n))
        q = np.where(np.array(arm.slides), np.round(q, 3), np.radians(np.round(np.degrees(q), 3)))
        point = posture(np.array(arm.rows), arm.slides, q, Deformation.none(len(q), arm.n)).point
        middle = np.median(point, axis=0)
        if side is None:
            direction = rng.standard_normal(3) * np.array([1.0, 1.0, 0.3])
            side = direction / np.linalg.norm(direction)
        ahead = (point - middle) @ side
        kept.append(q[ahead > np.quantile(ahead, 0.4)])
    return np.concatenate(kept)[:poses]


def _scanner(point: Array, reach: float, rng: np.random.Generator) -> Array:
    """(4, 4) scanner_T_base: its z axis looks at the middle of the points, a little beside it."""
    middle = point.mean(axis=0)
    away = rng.standard_normal(3) * np.array([1.0, 1.0, 0.35])
    place = middle + rng.uniform(1.3, 2.0) * reach * away / np.linalg.norm(away)
    z = middle + 0.03 * reach * rng.standard_normal(3) - place
    z /= np.linalg.norm(z)
    x = np.cross([0.0, 0.0, 1.0], z) + 1e-3 * rng.standard_normal(3)
    x /= np.linalg.norm(x)
    rotation = np.array([x, np.cross(z, x), z]) @ turned(0.05 * rng.standard_normal((1, 3)))[0]
    u, _, vt = np.linalg.svd(rotation)
    out = np.eye(4)
    out[:3, :3] = u @ vt
    out[:3, 3] = -out[:3, :3] @ place
    return out


def _temperatures(time_s: Array, rng: np.random.Generator) -> Array:
    """(N,) C: a hall that warms and cools with the day and the doors."""
    swing = sum(
        rng.uniform(1.0, 3.0) * np.sin(time_s * 2.0 * np.pi / rng.uniform(900.0, 5000.0) + rng.uniform(0, 6.28))
        for _ in range(3)
    )
    return np.round(22.0 + rng.uniform(-2.0, 4.0) * time_s / max(time_s[-1], 1.0) + swing, 2)
