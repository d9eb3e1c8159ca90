"""What an effect is drawn as: a scalar of each point, the channel, over an input; and how smooth a curve that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array

NOISE_MM = 0.05
LEVER = 0.25  # of the longest, that a joint's motion has to have at a pose for the pose to be drawn


@dataclass(frozen=True)
class Input:
    """What a channel is drawn over."""

    label: str
    values: Array  # (N,) at each pose
    is_tested: bool  # whether a diagnosis holds what is left against it

    @property
    def words(self) -> str:
        """The label without its unit."""
        return self.label.split(",")[0]


@dataclass(frozen=True)
class Channel:
    """A scalar of each point: its motion along an axis, or the turn of a joint that would make it."""

    label: str
    direction: Array  # (M, 3) whitened
    joint: int | None = None

    def of(self, rows: Array) -> Array:
        """(M,) of whitened rows (3 M,): mm, or mrad of a joint."""
        along = np.einsum("mi,mi->m", self.direction, rows.reshape(-1, 3))
        if self.joint is None:
            return NOISE_MM * along
        length = np.sum(self.direction**2, axis=1)
        return np.asarray(1e3 * along / np.maximum(length, 0.02 * float(length.max())))

    @property
    def tells(self) -> Array:
        """(M,) whether a turn of the joint moves the point enough to be told."""
        length = np.linalg.norm(self.direction, axis=1)
        return np.asarray(length > LEVER * float(length.max()))

    def most(self, rows: Array) -> float:
        """The sum of squares that `of` would have, were all of the rows along the direction."""
        size = np.linalg.norm(rows.reshape(-1, 3), axis=1)
        if self.joint is None:
            return float(NOISE_MM**2 * size @ size)
        length = np.linalg.norm(self.direction, axis=1)
        turn = 1e3 * size * length / np.maximum(length**2, 0.02 * float((length**2).max()))
        return float(turn @ turn)


def roughness(u: Array, y: Array) -> float:
    """Von Neumann's ratio over an input: near 0 where y is a curve of it, near 1 where it is not; 1 at the most."""
    order = np.lexsort((y, u)) if len(np.unique(u)) < 0.5 * len(u) else np.argsort(u, kind="stable")
    if len(np.unique(u)) < 0.5 * len(u):  # levels: what differs within one
        levels, index = np.unique(u, return_inverse=True)
        means = np.bincount(index, y) / np.bincount(index)
        return min(float(np.var(y - means[index]) / max(np.var(y), 1e-300)), 1.0) if len(levels) > 1 else 1.0
    steps = np.diff(y[order])
    return min(float(np.mean(steps**2) / (2.0 * max(np.var(y), 1e-300))), 1.0)


def label_of(name: str) -> str:
    """What stands at the axis of an input, its unit behind a comma."""
    stem = name.rstrip("0123456789")
    words = {"q": "deg", "torque": "Nm"}
    if stem in words and name != stem:
        what = {"q": "angle of joint", "torque": "gravity's torque about joint"}[stem]
        return f"{what} {name[len(stem) :]}, {words[stem]}"
    if stem == "approach":
        return f"side from which joint {name[len(stem) :]} came"
    shown = {
        "temperature_c": "temperature, C", "time_s": "time, min", "payload_kg": "payload, kg",
        "order": "number of the pose", "x": "x in the instrument's frame, mm", "y": "y in the scanner's frame, mm",
        "z": "depth in the instrument's frame, mm",
    }  # fmt: skip
    return shown.get(name, name)


def in_shown_unit(name: str, u: Array) -> Array:
    """An input (N,) in the unit of its label."""
    if name.startswith("q"):
        return np.degrees(u)
    return u / 60.0 if name == "time_s" else u
