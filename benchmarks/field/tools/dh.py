"""Denavit and Hartenberg's rows as matrices, for tools that take them so; numpy alone."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def along(a: float, alpha: float) -> Array:
    """Trans(a, 0, 0) Rx(alpha), (4, 4)."""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def spin(theta: float, d: float) -> Array:
    """Rz(theta) Trans(0, 0, d), (4, 4)."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1.0]])


def mdh_of(table: Array) -> tuple[Array, Array]:
    """DH rows a, alpha, d, theta as modified DH rows alpha, a, theta, d (n, 4), and the tool's transform (4, 4)."""
    a, alpha, d, theta = table[:-1].T
    before_a, before_alpha = np.r_[0.0, a[:-1]], np.r_[0.0, alpha[:-1]]
    tool = along(a[-1], alpha[-1]) @ spin(table[-1, 3], table[-1, 2]) @ along(table[-1, 0], table[-1, 1])
    return np.column_stack([before_alpha, before_a, theta, d]), tool


def points_of(table: Array, q: Array) -> Array:
    """Points (N, 3) of the tool by the rows (n + 1, 4) of a, alpha, d, theta at joints (N, n), in the base frame."""
    turn, at = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
    for k, (a, alpha, d, theta) in enumerate(table):
        angle = theta + (q[:, k] if k < q.shape[1] else np.zeros(len(q)))
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        zero, one = np.zeros(len(q)), np.ones(len(q))
        at = at + np.einsum("nij,nj->ni", turn, np.stack([a * c, a * s, d * one], axis=1))
        own = np.stack([c, -s * ca, s * sa, s, c * ca, -c * sa, zero, sa * one, ca * one], axis=1).reshape(-1, 3, 3)
        turn = turn @ own
    return at
