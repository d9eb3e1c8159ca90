"""Causes that have an order in time: knocks, slips, warmth, an instrument that wanders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.support.third_engine.joint_laws import Rng, carriers, joint_cause
from tests.support.third_engine.load_laws import period
from tests.support.third_engine.screws import Array, Flex, Stance
from tests.support.third_engine.session import Cause, Session


def _joint_over(law: str, when: Array, session: Session, rng: Rng) -> Cause:
    way = np.repeat(when[:, None], session.make.n, axis=1)
    share = carriers(session, rng, way, allowed=session.make.turns) * rng.choice([-1.0, 1.0])
    return joint_cause(law, lambda s, here: share * way, ("joint_step",))


def joint_step(session: Session, rng: Rng) -> Cause:
    """A joint's zero slips."""
    return _joint_over("joint_step", period(session, rng), session, rng)


def joint_knocked_and_put_back(session: Session, rng: Rng) -> Cause:
    """A joint's zero slips, and somebody puts it right again."""
    return _joint_over("joint_knocked_and_put_back", period(session, rng, back=True), session, rng)


def late_joint_step(session: Session, rng: Rng) -> Cause:
    """A joint's zero slips shortly before the end."""
    return _joint_over("late_joint_step", period(session, rng, late=True), session, rng)


def belt_jump(session: Session, rng: Rng) -> Cause:
    """A belt jumps a tooth at each of three moves, forth and back and forth."""
    at = np.sort(rng.choice(np.arange(session.count // 6, 5 * session.count // 6), 3, replace=False))
    teeth = sum((-1.0) ** k * (np.arange(session.count) >= first) for k, first in enumerate(at))
    return _joint_over("belt_jump", teeth, session, rng)


def remastered(session: Session, rng: Rng) -> Cause:
    """On one day of several a joint's zero was another."""
    day = int(rng.integers(1, len(session.view)))
    return _joint_over("wrong_day_zero", (session.setup == day).astype(float), session, rng)


def other_seat(session: Session, rng: Rng) -> Cause:
    """On one day of several the target sat elsewhere on the tool."""
    day = int(rng.integers(1, len(session.view)))
    return _target(session, rng, "wrong_day_seat", (session.setup == day).astype(float))


def other_air(session: Session, rng: Rng) -> Cause:
    """On one day of several the tracker's air pressure was wrong: all distances by the same share."""
    day = int(rng.integers(1, len(session.view)))

    def report(s: Session, here: Stance, seen: Array, size: float) -> Array:
        return 1e-4 * size * (s.setup == day)[:, None] * seen

    return Cause("wrong_day_air", ("scale_step", "scanner_scale"), report=report)


def _target(session: Session, rng: Rng, law: str, when: Array) -> Cause:
    way = rng.standard_normal(3)

    def flex(s: Session, here: Stance, size: float) -> Flex:
        return replace(s.still, tool=0.1 * size * when[:, None] * way)

    return Cause(law, ("target_step",), flex)


def target_step(session: Session, rng: Rng) -> Cause:
    """The target slips on the tool."""
    return _target(session, rng, "target_step", period(session, rng))


def _seen_turn(session: Session, rng: Rng) -> tuple[Array, Array, Array]:
    """A shift (3,), a turn (3,) and the middle (3,) of a motion of the instrument of which both show alike."""
    seen = session.seen(session.plain.tip)
    middle = seen.mean(axis=0)
    return rng.standard_normal(3), rng.standard_normal(3) / np.sqrt(np.mean((seen - middle) ** 2)), middle


def _moved(
    session: Session, rng: Rng, law: str, course: Array, names: tuple[str, ...], *, outside: bool = False
) -> Cause:
    """The instrument moves rigidly along a course (N,)."""
    shift, turn, middle = _seen_turn(session, rng)

    def report(s: Session, here: Stance, seen: Array, size: float) -> Array:
        return 0.1 * size * course[:, None] * (shift + np.cross(turn, seen - middle))

    return Cause(law, names, outside=outside, report=report)


def scanner_drift(session: Session, rng: Rng) -> Cause:
    """The stand sinks evenly."""
    return _moved(session, rng, "scanner_drift", session.part, ("scanner_drift",))


def settling_stand(session: Session, rng: Rng) -> Cause:
    """The stand sinks ever more slowly."""
    course = 1.0 - np.exp(-session.part / rng.uniform(0.15, 0.4))
    return _moved(session, rng, "settling_stand", course, ("scanner_drift",), outside=True)


def scanner_step(session: Session, rng: Rng) -> Cause:
    """Somebody runs into the stand."""
    return _moved(session, rng, "scanner_step", period(session, rng), ("scanner_step",))


def beam_wander(session: Session, rng: Rng) -> Cause:
    """A tracker's two angles and its distance wander, each by itself, without returning."""
    walk = np.cumsum(
        rng.standard_normal((session.count, 3)) * np.sqrt(np.diff(session.time_s, prepend=0.0))[:, None], 0
    )
    walk = (walk - walk.mean(axis=0)) / np.maximum(walk.std(axis=0), 1e-9) * rng.uniform(0.3, 1.0, 3)

    def report(s: Session, here: Stance, seen: Array, size: float) -> Array:
        return beam_error(seen, 1e-4 * size * walk[:, 0], 1e-4 * size * walk[:, 1], 0.02 * size * walk[:, 2])

    return Cause("beam_wander", ("scanner_drift",), outside=True, report=report, noise=True)


def beam_drift(session: Session, rng: Rng) -> Cause:
    """A tracker's two angles drift with its own warmth, fast at first."""
    course = 1.0 - np.exp(-session.part / rng.uniform(0.2, 1.5))
    one, other = rng.standard_normal(2)

    def report(s: Session, here: Stance, seen: Array, size: float) -> Array:
        return beam_error(seen, 1e-4 * size * one * course, 1e-4 * size * other * course, np.zeros(s.count))

    return Cause("beam_drift", ("scanner_drift",), outside=True, report=report)


def beam_error(seen: Array, azimuth: Array, elevation: Array, depth_mm: Array) -> Array:
    """(N, 3) displacement of seen points by errors of a beam's angles (about y, about the horizontal) and length."""
    ray = seen / np.linalg.norm(seen, axis=1)[:, None]
    side = np.cross(np.array([0.0, 1.0, 0.0]), ray)
    side = side / np.linalg.norm(side, axis=1)[:, None]
    up = np.cross(ray, side)
    far = np.linalg.norm(seen, axis=1)
    return (far * azimuth)[:, None] * side + (far * elevation)[:, None] * up + depth_mm[:, None] * ray


def link_step(session: Session, rng: Rng) -> Cause:
    """A knock bends a link: its end turns about the common normal (alpha), and moves along it (a) and the axis (d)."""
    when = period(session, rng)
    link = int(rng.integers(0, session.make.n - 1))
    part = rng.uniform(0.3, 1.0, 3) * rng.choice([-1.0, 1.0], 3)
    cross, axis = session.build.cross[link], session.build.axis[link]

    def flex(s: Session, here: Stance, size: float) -> Flex:
        bend, give = np.zeros((s.count, s.make.n, 3)), np.zeros((s.count, s.make.n, 3))
        bend[:, link] = 2e-4 * size * when[:, None] * part[0] * cross
        give[:, link] = 0.1 * size * when[:, None] * (part[1] * cross + part[2] * axis)
        return replace(s.still, bend=bend, give=give)

    return Cause("link_step", ("link_step",), flex)


def warm_up(session: Session, rng: Rng) -> Cause:
    """An arm switched on in the cold: its lengths grow towards a value, and no thermometer is read."""
    course = 1.0 - np.exp(-session.part / rng.uniform(0.15, 0.4))

    def flex(s: Session, here: Stance, size: float) -> Flex:
        return replace(s.still, growth=1e-4 * size * course)

    return Cause("warm_up", ("warm_up",), flex)


def thermal_growth(session: Session, rng: Rng) -> Cause:
    """Lengths grow with the temperature that is written down."""
    return _grown("thermal_growth", session.temperature_c - 20.0)


def lagging_growth(session: Session, rng: Rng) -> Cause:
    """Lengths grow with the hall's temperature, a tenth to a quarter of an hour later."""
    lag = rng.uniform(360.0, 900.0)
    state, course = session.temperature_c[0], np.zeros(session.count)
    for k in range(session.count):
        step = session.time_s[k] - session.time_s[max(k - 1, 0)]
        state = session.temperature_c[k] + (state - session.temperature_c[k]) * np.exp(-step / lag)
        course[k] = state - 20.0
    return _grown("lagging_growth", course, outside=True)


def _grown(law: str, course: Array, *, outside: bool = False) -> Cause:
    def flex(s: Session, here: Stance, size: float) -> Flex:
        return replace(s.still, growth=1e-5 * size * course)

    return Cause(law, ("thermal_growth",), flex, outside=outside)


def motor_heat(session: Session, rng: Rng) -> Cause:
    """A motor warms by its own work, the housing fast, the link slowly; a warm link is longer and turns a little."""
    n, spent = session.make.n, np.diff(session.time_s, prepend=-30.0)
    shifts = np.sin(session.part * rng.uniform(4.0, 9.0) + rng.uniform(0.0, 6.28)) > 0.0
    unsaid = rng.random() < 0.5  # whether it also worked between the poses, at times, as no sheet says
    busy = 1.0 + 2.5 * shifts * unsaid
    work = np.abs(session.travel) / np.maximum(session.span, 1e-9) * (busy / spent)[:, None]
    work = work / work.mean(axis=0)
    heat = np.zeros_like(session.q)
    for share, constant in ((0.45, 0.06), (0.55, 0.35)):
        state = np.zeros(n)
        for k in range(session.count):
            state = work[k] + (state - work[k]) * np.exp(-spent[k] / (constant * session.time_s[-1]))
            heat[k] += share * state
    carrier = int(rng.integers(1, max(2, n // 2)))
    span = session.build.end[carrier] - session.build.through[carrier]
    along = span / max(float(np.linalg.norm(span)), 1e-9)
    turn = rng.uniform(0.0, 0.6) * rng.choice([-1.0, 1.0])

    def flex(s: Session, here: Stance, size: float) -> Flex:
        give, joint = np.zeros((s.count, n, 3)), np.zeros_like(s.q)
        give[:, carrier] = 0.1 * size * heat[:, [carrier]] * along
        joint[:, carrier] = turn * size * s.units[carrier] * heat[:, carrier]
        return replace(s.still, give=give, joint=joint)

    return Cause("motor_heat", ("motor_heat", "warm_up"), flex, outside=unsaid)
