"""Noise of board poses that another program measured: four variances, and a drift where errors accumulate.

A camera sees a board's distance and tilt worse than its place across the sight and its turn about it, often many times:
each of the four has a variance of its own. Where poses follow one another, camera or board may creep, as the world of
visual odometry does: a random walk, whose steps are shifts and turns of the camera about itself, told by its slowest
modes. It is told where the errors of an arm that is held explain them less. All are of the greatest restricted
likelihood (Patterson and Thompson 1971) about a fit of links, camera and board, found by multiplying each variance by
the root of what errors have of it over what they should have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray

_LEAST = np.array([1e-6, 1e-6, 3e-10, 3e-10])  # mm^2, rad^2
_FEWEST, _MODES, _GAIN = 20, 8, 8.0  # poses, modes of an axis, and log likelihood, from which a drift is told
_ROUNDS, _SETTLED, _FASTEST = 60, 1e-2, 20.0  # of the search: rounds, gain that ends it, ratio of successive variances
_OPEN = 1e-10  # share below which the poses leave an unknown open
_TOLD = 0.1  # noise's sigmas, from which a mode is worth keeping
_FRAMES, _LINKS, _SHIFT, _TURN, _LENGTH, _ANGLE = -1, 0, 1, 2, 3, 4  # kinds of unknowns; of a drift, of a held arm


@dataclass(frozen=True)
class PoseNoise:
    """Noise of M poses of a board in the camera's frame."""

    variances: Array  # (4,) of an axis: place across and along the sight, mm^2, turn across and along it, rad^2
    covariance: Array  # (M, 6, 6) mm and rad
    shared: Array  # (M, 6, K) changes of the poses by a drift
    step: Array  # (2,) sigmas of an axis of the drift from pose to pose, mm and rad; 0 without one


def noise_of_poses(
    camera_T_board: Array,
    errors: Array,
    by_frames: Array,
    by_links: Array,
    by_held: tuple[Array, BoolArray],
    *,
    sigma_mm: float | None,
) -> PoseNoise:
    """Noise of poses (M, 4, 4), by their errors (M, 6) at a fit and the errors' derivatives (M, 6, P), mm and rad.

    by_frames: by unknowns of which nothing else is known. by_links: by those of the arm, one sigma of each. by_held: by
    the tolerances of an arm that is held (M, 6, H), and which of these are lengths.
    sigma_mm: of an axis of the places, where it was told.
    """
    count = len(errors)
    place_mm = camera_T_board[:, :3, 3]
    sight = place_mm / np.maximum(np.linalg.norm(place_mm, axis=1, keepdims=True), 1e-9)
    along = np.einsum("mi,mj->mij", sight, sight)
    parts = np.zeros((4, count, 6, 6))
    parts[0, :, :3, :3] = parts[2, :, 3:, 3:] = np.eye(3) - along
    parts[1, :, :3, :3] = parts[3, :, 3:, 3:] = along
    known = [(by_frames, _FRAMES), (by_links, _LINKS)]
    start = np.repeat([np.mean(part**2) for part in (errors[:, :3], errors[:, 3:])], 2)
    variances, size, height = _likeliest(errors, parts, known, sigma_mm, start, np.ones(4))
    shared, step = np.zeros((count, 6, 0)), np.zeros(2)
    if count >= _FEWEST:
        before, (columns, is_length) = variances, by_held
        known += [(columns[:, :, is_length], _LENGTH), (columns[:, :, ~is_length], _ANGLE)]
        steps = np.sqrt(start[[0, 2]] / count)
        size = np.array([*steps, 0.1, 0.1])
        if columns.shape[2]:
            _, size, held = _likeliest(errors, parts, known, sigma_mm, 0.5 * before, size)
            height = max(height, held)
        for where in (np.broadcast_to(np.eye(4), camera_T_board.shape), frames.invert(camera_T_board)):
            shifts, turns = _walk(where, camera_T_board)
            both = [*known, (shifts, _SHIFT), (turns, _TURN)]
            then, sizes, higher = _likeliest(errors, parts, both, sigma_mm, 0.5 * before, size)
            if higher > height + _GAIN:
                variances, step, height = then, sizes[:2], higher - _GAIN
                shared = np.concatenate([step[0] * shifts, step[1] * turns], axis=2)
    covariance = np.tensordot(variances, parts, 1)
    if shared.shape[2]:
        white = np.linalg.solve(np.linalg.cholesky(covariance), shared).reshape(6 * count, -1)
        _, told, ways = np.linalg.svd(white, full_matrices=False)
        shared = shared @ ways[told > _TOLD].T
    return PoseNoise(variances, covariance, shared, step)


def _likeliest(
    errors: Array,
    parts: Array,
    known: Sequence[tuple[Array, int]],
    sigma_mm: float | None,
    variances: Array,
    size: Array,
) -> tuple[Array, Array, float]:
    """Likeliest variances (4,) of parts (4, M, 6, 6), sizes (4,) of unknowns from `_SHIFT` on, and log likelihood.

    known: derivatives (M, 6, P) of the errors by unknowns, with their kind.
    """
    count = len(errors)
    kind = np.repeat([one for _, one in known], [part.shape[2] for part, _ in known])
    columns = np.concatenate([part for part, _ in known], axis=2)
    height = -np.inf
    for _ in range(_ROUNDS):
        variances = np.maximum(variances, _LEAST)
        if sigma_mm is not None:
            variances[:2] = sigma_mm**2
        root = np.linalg.cholesky(np.tensordot(variances, parts, 1))
        inverse = np.linalg.inv(root)
        back = np.swapaxes(inverse, 1, 2)
        white = (inverse @ (columns * np.array([1.0, *size, 1.0])[kind])).reshape(6 * count, -1)
        error = (inverse @ errors[:, :, None]).ravel()
        information = white.T @ white + np.diag(np.where(kind == _FRAMES, 0.0, 1.0))
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        bend, ways = np.linalg.eigh(information / np.outer(scale, scale))
        told = bend > _OPEN
        spread = (ways[:, told] / bend[told]) @ ways[:, told].T / np.outer(scale, scale)
        found = -spread @ (white.T @ error)
        left = error + white @ found
        logs = np.sum(np.log(np.diagonal(root, axis1=1, axis2=2))) + np.sum(np.log(scale))
        before, height = height, -logs - 0.5 * (np.sum(np.log(bend[told])) + error @ left)
        if height - before < _SETTLED:
            break
        best = variances, size
        pull = (back @ left.reshape(count, 6, 1))[:, :, 0]
        moved = back @ white.reshape(count, 6, -1)
        free = back @ inverse - moved @ spread @ np.swapaxes(moved, 1, 2)
        has = np.einsum("ni,knij,nj->k", pull, parts, pull)
        should = np.einsum("nij,knji->k", free, parts)
        ratio = np.sqrt(np.maximum(has, 0.0) / np.maximum(should, 1e-300))
        variances = variances * np.clip(ratio, 1.0 / _FASTEST, _FASTEST)
        size = size.copy()
        for one in np.unique(kind[kind >= _SHIFT]):
            mine = kind == one
            shown = np.sum(found[mine] ** 2) / max(np.sum(1.0 - np.diag(spread)[mine]), 1e-9)
            size[one - _SHIFT] *= np.clip(shown**0.25, 0.3, 3.0)
    return (*best, float(height))


def _walk(there_T_camera: Array, camera_T_board: Array) -> tuple[Array, Array]:
    """Changes (M, 6, 3 K) of poses by K modes of shifts of a camera from pose to pose, and those of turns about it.

    Steps are white noise, told by its K slowest cosines, and add up in the frame `there`: the camera's where it creeps
    on its mount, the board's where that does or the camera's world.
    """
    count = len(camera_T_board)
    turn, at_mm = there_T_camera[:, :3, :3], there_T_camera[:, :3, 3]
    board_mm = (there_T_camera @ camera_T_board)[:, :3, 3]
    rate = np.pi * (np.arange(_MODES) + 0.5) / count
    steps = np.sqrt(2.0 / count) * np.cos(np.outer(np.arange(count) + 0.5, rate))
    walked = np.cumsum(steps, axis=0)
    lever = board_mm[:, None] * walked[:, :, None] - np.cumsum(steps[:, :, None] * at_mm[:, None], axis=0)
    back = np.swapaxes(turn, 1, 2)[:, None]
    turned = back * walked[:, :, None, None]
    shifts = np.concatenate([turned, np.zeros_like(turned)], axis=2)  # (M, K, 6, 3)
    turns = np.concatenate([-back @ frames.skew(lever), turned], axis=2)
    shifts, turns = (np.moveaxis(part, 1, 2).reshape(count, 6, -1) for part in (shifts, turns))
    return shifts, turns
