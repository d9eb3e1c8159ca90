"""Causes that no catalogue has; where a name is true of one nevertheless, it says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.support.third_engine.joint_laws import Rng, carriers, joint_cause
from tests.support.third_engine.load_laws import tool_down
from tests.support.third_engine.order_laws import beam_error, belt_jump
from tests.support.third_engine.screws import Array, Flex, Stance
from tests.support.third_engine.session import Cause, Session


def sunlit_link(session: Session, rng: Rng) -> Cause:
    """The sun goes round the hall: a long link bends away from the side that it shines on, more at noon."""
    long = np.linalg.norm(session.build.end - session.build.through, axis=1) * session.make.turns
    link = int(np.argmax(long))
    azimuth = rng.uniform(0.0, 6.28) + 2.2 * session.part
    sun = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.full(session.count, 0.6)])
    strength = np.sin(np.pi * (0.1 + 0.8 * session.part))
    span = session.build.end[link] - session.build.through[link]

    def flex(s: Session, here: Stance, size: float) -> Flex:
        bend, give = np.zeros((s.count, s.make.n, 3)), np.zeros((s.count, s.make.n, 3))
        turn = 1e-4 * size * strength[:, None] * np.cross(here.body[link].back(sun), span / np.linalg.norm(span))
        bend[:, link] = turn
        give[:, link] = np.cross(turn, 0.5 * span)  # an even curvature
        return replace(s.still, bend=bend, give=give)

    return Cause("sunlit_link", flex=flex)


def loose_flange(session: Session, rng: Rng) -> Cause:
    """A flange bolt is loose: the tool rocks over about an axis across the flange, to where its weight hangs."""
    axis = session.build.axis[-1]
    across = np.cross(axis, rng.standard_normal(3))
    across = across / np.linalg.norm(across)
    lever = session.build.tool - session.build.end[-1]
    lever = lever + 40.0 * axis

    def flex(s: Session, here: Stance, size: float) -> Flex:
        moment = np.cross(np.broadcast_to(lever, (s.count, 3)), tool_down(s, here)) @ across
        side = np.tanh(moment / (0.05 * np.linalg.norm(lever)))
        return replace(s.still, tool=0.1 * size * side[:, None] * np.cross(across, lever / np.linalg.norm(lever)))

    return Cause("loose_flange", flex=flex)


def hot_plume(session: Session, rng: Rng) -> Cause:
    """The beam passes through a plume over an oven: bent sideways on one side of it and back on the other."""
    seen = session.seen(session.plain.tip)
    azimuth = np.arctan2(seen[:, 0], seen[:, 2])
    middle, width = np.quantile(azimuth, rng.uniform(0.3, 0.7)), 0.35 * azimuth.std()

    def report(s: Session, here: Stance, at: Array, size: float) -> Array:
        u = (np.arctan2(at[:, 0], at[:, 2]) - middle) / width
        lens = u * np.exp(-0.5 * u**2)
        return beam_error(at, 1e-4 * size * lens, 0.5e-4 * size * np.exp(-0.5 * u**2), np.zeros(s.count))

    return Cause("hot_plume", report=report)


def bending_fingers(session: Session, rng: Rng) -> Cause:
    """Gripper fingers bend outwards under their weight and rest on a stop inwards."""
    way = np.cross(session.build.axis[-1], rng.standard_normal(3))
    way = way / np.linalg.norm(way)

    def flex(s: Session, here: Stance, size: float) -> Flex:
        out = np.maximum(tool_down(s, here) @ way, 0.0)
        return replace(s.still, tool=0.1 * size * out[:, None] * way)

    return Cause("bending_fingers", ("tool_sag",), flex, outside=True)


def cable_chain(session: Session, rng: Rng) -> Cause:
    """A harness over two joints goes taut beyond some slack on either side and pulls the first one back."""
    pair = session.q[:, :-1] + session.q[:, 1:]
    slack = rng.uniform(0.3, 0.8) * np.std(pair, axis=0)
    off = pair - np.median(pair, axis=0)
    way = np.zeros_like(session.q)
    way[:, :-1] = -np.sign(off) * np.maximum(np.abs(off) - slack, 0.0)
    both = np.append(session.make.turns[:-1] * session.make.turns[1:], 0.0)
    share = carriers(session, rng, way, allowed=both)
    return joint_cause("cable_chain", lambda s, here: share * way, ("cable_drag",), outside=True)


def mirror_eccentricity(session: Session, rng: Rng) -> Cause:
    """The instrument's azimuth encoder sits eccentric and its heads do not average it away: twice a turn."""
    phase = rng.uniform(0.0, 6.28)

    def report(s: Session, here: Stance, seen: Array, size: float) -> Array:
        azimuth = np.arctan2(seen[:, 0], seen[:, 2])
        return beam_error(seen, 1e-4 * size * np.sin(2.0 * azimuth - phase), np.zeros(s.count), np.zeros(s.count))

    return Cause("mirror_eccentricity", ("scanner_distortion",), outside=True, report=report)


def brake_slip(session: Session, rng: Rng) -> Cause:
    """A brake closes before each reading and throws its joint by chance: no order, but more than the noise."""
    way = rng.standard_normal(session.q.shape)
    share = carriers(session, rng, way, allowed=session.make.turns)
    return joint_cause("brake_slip", lambda s, here: share * way, (), noise=True)


def two_seats(session: Session, rng: Rng) -> Cause:
    """The target's nest holds a grain of dirt: at every third pose or so it sits tilted."""
    tilted, way = rng.random(session.count) < 0.35, rng.standard_normal(3)

    def flex(s: Session, here: Stance, size: float) -> Flex:
        return replace(s.still, tool=0.1 * size * tilted[:, None] * way)

    return Cause("two_seats", flex=flex)


def creaking_column(session: Session, rng: Rng) -> Cause:
    """A column under the arm sticks and slips: it leans after its moment only when that has changed by enough."""
    moment = session.plain.moment_about(np.zeros((session.count, 3)), 0)
    hold = 0.6 * moment.std(axis=0)
    state, lean = moment[0].copy(), np.zeros_like(moment)
    for k in range(session.count):
        off = moment[k] - state
        state = state + np.sign(off) * np.maximum(np.abs(off) - hold, 0.0)
        lean[k] = state

    def flex(s: Session, here: Stance, size: float) -> Flex:
        turn = 1e-6 * size * lean * np.array([1.0, 1.0, 0.0])
        return replace(s.still, foot_turn=turn)

    return Cause("creaking_column", ("base_compliance",), flex, outside=True)


INVENTIONS = {
    cause.__name__: cause
    for cause in (
        *(sunlit_link, loose_flange, hot_plume, bending_fingers, cable_chain),
        *(mirror_eccentricity, brake_slip, two_seats, creaking_column, belt_jump),
    )
}
