"""Causes in joints: gears, encoders, play, friction along the path, following errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.support.third_engine.screws import Array, Flex, Stance
from tests.support.third_engine.session import Cause, Session

Rng = np.random.Generator
Law = Callable[[Session, Stance], Array]  # (N, n) in small motions of each joint


def joint_cause(law: str, way: Law, names: tuple[str, ...], **more: object) -> Cause:
    """A cause that adds size times `way` small motions to the joints."""

    def flex(session: Session, here: Stance, size: float) -> Flex:
        return replace(session.still, joint=size * session.units * way(session, here))

    return Cause(law, names, flex, **more)  # type: ignore[arg-type]


def carriers(session: Session, rng: Rng, way: Array, *, most: int = 1, allowed: Array | None = None) -> Array:
    """(n,) shares of one to `most` joints whose error `way` (N, n) shows by a sixth of the best; 0 of others."""
    n = session.make.n
    allowed = np.ones(n) if allowed is None else allowed
    shown = np.array([
        session.joint_left_mm(j, session.units[j] * way[:, j]) if allowed[j] and np.any(way[:, j]) else 0.0
        for j in range(n)
    ])  # fmt: skip
    share = np.zeros(n)
    if shown.max() > 1e-7:
        good = rng.permutation(np.flatnonzero(shown > shown.max() / 6.0))
        chosen = good[: rng.integers(1, most + 1)]
        share[chosen] = rng.uniform(0.6, 1.4, len(chosen))
    return share


def _by_angle(
    law: str, way: Array, session: Session, rng: Rng, names: tuple[str, ...], *, most: int, signed: bool
) -> Cause:
    share = carriers(session, rng, way, most=most, allowed=session.make.turns)
    if signed:
        share = share * rng.choice([-1.0, 1.0], len(share))
    return joint_cause(law, lambda s, here: share * way, names)


def waves(session: Session, rng: Rng, orders: tuple[int, ...], law: str, *, most: int = 2) -> Cause:
    """One or more joints with all waves of `orders`, of like size; the names follow from the orders."""
    phase = rng.uniform(0.0, 2.0 * np.pi, (len(orders), session.make.n))
    way = sum(np.cos(n * session.q - phase[k]) for k, n in enumerate(orders))
    share = carriers(session, rng, way, most=most, allowed=session.make.turns)
    names = tuple(dict.fromkeys("transmission_error" if n <= 3 else "high_harmonic" for n in orders))

    def known(size: float) -> dict[str, float]:
        out = {}
        for k, n in enumerate(orders):
            effect = "transmission_error" if n <= 3 else "high_harmonic"
            for j in np.flatnonzero(share):
                out[f"{effect}.J{j + 1}.sin{n}_rad"] = float(size * 1e-4 * share[j] * np.sin(phase[k, j]))
                out[f"{effect}.J{j + 1}.cos{n}_rad"] = float(size * 1e-4 * share[j] * np.cos(phase[k, j]))
        return out

    return joint_cause(law, lambda s, here: share * way, names, known=known, every=True)


def transmission_error(session: Session, rng: Rng) -> Cause:
    """A gear that errs two or three times a turn."""
    return waves(session, rng, (int(rng.integers(2, 4)),), "transmission_error")


def encoder_eccentricity(session: Session, rng: Rng) -> Cause:
    """A code disc off its axis: the angle of a point of a circle seen from beside its middle."""
    phase = rng.uniform(0.0, 2.0 * np.pi, session.make.n)
    share = carriers(session, rng, np.sin(session.q - phase), most=2, allowed=session.make.turns)

    def flex(s: Session, here: Stance, size: float) -> Flex:
        off = size * s.units * share
        angle = np.arctan2(off * np.sin(s.q - phase), 1.0 + off * np.cos(s.q - phase))
        return replace(s.still, joint=np.where(s.make.slides, 0.0, angle))

    def known(size: float) -> dict[str, float]:
        out = {}
        for j in np.flatnonzero(share):
            out[f"transmission_error.J{j + 1}.sin1_rad"] = float(size * 1e-4 * share[j] * np.cos(phase[j]))
            out[f"transmission_error.J{j + 1}.cos1_rad"] = float(-size * 1e-4 * share[j] * np.sin(phase[j]))
        return out

    return Cause("encoder_eccentricity", ("transmission_error",), flex, known=known)


def high_harmonic(session: Session, rng: Rng) -> Cause:
    """Teeth of one gear."""
    return waves(session, rng, (int(rng.integers(5, 19)),), "high_harmonic", most=1)


def strain_wave(session: Session, rng: Rng) -> Cause:
    """Twice in a turn of the motor."""
    way = np.cos(2.0 * session.make.gear * session.q - rng.uniform(0.0, 6.28, session.make.n))
    return _by_angle("strain_wave", way, session, rng, ("strain_wave",), most=2, signed=False)


def joint_scale(session: Session, rng: Rng) -> Cause:
    """A wrong ratio."""
    return _by_angle("joint_scale", session.q / 1.5, session, rng, ("joint_scale",), most=2, signed=True)


def asymmetric_scale(session: Session, rng: Rng) -> Cause:
    """A ratio that differs on both sides of zero, where poses are on both."""
    both = (np.abs(np.mean(session.q > 0.0, axis=0) - 0.5) < 0.3) * np.abs(session.q)
    return _by_angle("asymmetric_scale", both, session, rng, ("asymmetric_scale",), most=1, signed=True)


def joint_coupling(session: Session, rng: Rng) -> Cause:
    """A wrist's last joint dragged by the one before."""
    way = np.zeros_like(session.q)
    if session.make.turns[-1] and session.make.turns[-2]:
        way[:, -1] = session.q[:, -2]
    return _by_angle("joint_coupling", way, session, rng, ("joint_coupling",), most=1, signed=True)


def joint_dent(session: Session, rng: Rng) -> Cause:
    """A place in a gear, as a raised cosine, where at least seven poses are."""
    place, half = session.q[rng.integers(session.count)], rng.uniform(0.3, 0.55)
    off = np.clip((session.q - place) / half, -1.0, 1.0)
    way = (1.0 + np.cos(np.pi * off)) * (np.sum(np.abs(off) < 1.0, axis=0) >= 7)
    return _by_angle("joint_dent", way, session, rng, ("joint_dent",), most=1, signed=True)


def backlash(session: Session, rng: Rng) -> Cause:
    """Play to the side that is written in the sheet."""
    share = carriers(session, rng, session.approach, most=2, allowed=session.make.turns)
    return joint_cause("backlash", lambda s, here: share * s.approach, ("backlash",))


def following(session: Session, rng: Rng) -> Cause:
    """The sheet has the commanded joints: the arm stops short by its side and, less than in proportion, by its way."""
    mix = rng.uniform(0.15, 0.85)
    far = np.abs(session.travel) / np.sqrt(np.mean(session.travel**2, axis=0))
    way = -np.sign(session.travel) * (mix + (1.0 - mix) * far ** rng.uniform(0.6, 1.0))
    share = carriers(session, rng, way, most=3)
    names = ("following_error", "backlash", "path_friction")
    return joint_cause("following", lambda s, here: share * way, names, outside=True)


def _along_path(session: Session, step: Callable[[Array, Array], Array]) -> Array:
    """(N, n) a state that each move (n,) changes, over all poses in the order measured."""
    state, out = np.zeros(session.make.n), np.zeros_like(session.q)
    for lap in range(2):  # the first pose is come to by way of a warm-up lap
        for k in range(session.count):
            state = step(state, session.travel[k])
            if lap:
                out[k] = state
    return out


def _lost_motion(law: str, state: Array, session: Session, rng: Rng) -> Cause:
    share = carriers(session, rng, state, most=2, allowed=session.make.turns)
    side = session.approach
    alike = [
        abs(np.corrcoef(state[:, j], side[:, j])[0, 1]) > 0.97 if np.ptp(side[:, j]) > 0 else False
        for j in np.flatnonzero(share)
    ]
    names = ("path_friction", "backlash")[: 1 + all(alike)]  # then it is nothing but the side
    return joint_cause(law, lambda s, here: share * state, names)


def dahl_friction(session: Session, rng: Rng) -> Cause:
    """Dahl's friction winds a joint up: it turns over within a share of a usual move."""
    reach = rng.uniform(0.2, 0.9) * np.median(np.abs(session.travel), axis=0) + 1e-9

    def step(state: Array, move: Array) -> Array:
        side = np.sign(move)
        return side - (side - state) * np.exp(-np.abs(move) / reach)

    return _lost_motion("dahl_friction", -_along_path(session, step), session, rng)


def play_operator(session: Session, rng: Rng) -> Cause:
    """A spring and a dry slider, several of different widths (Maxwell's slip): hysteresis without rate."""
    width = np.array([0.15, 0.4, 0.9])[:, None] * np.median(np.abs(session.travel), axis=0)
    total = np.zeros_like(session.q)
    for w in width + 1e-9:
        total -= _along_path(session, lambda state, move, w=w: np.clip(state + move, -w, w)) / w / len(width)
    return _lost_motion("play_operator", total, session, rng)
