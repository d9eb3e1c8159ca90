"""Causes that weight brings about, and weights that nobody wrote down."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.support.third_engine.joint_laws import Rng, carriers, joint_cause
from tests.support.third_engine.screws import Array, Flex, Load, Stance
from tests.support.third_engine.session import Cause, Session

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
NODES, WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
"""Gauss-Legendre along a link, from its joint (0) to its end (1)."""
FRICTION_NM = 0.5
"""A joint that never bears more, as all of a SCARA's that turn, is held by its friction."""


def torques(session: Session, here: Stance) -> Array:
    """(N, n) gravity's torques, Nm; 0 where a joint slides."""
    return np.column_stack([here.torque(j) * session.make.turns[j] for j in range(session.make.n)])


def _largest(session: Session) -> Array:
    return np.maximum(np.abs(torques(session, session.plain)).max(axis=0), 1e-9)


def _loaded(session: Session) -> Array:
    largest = _largest(session)
    return session.make.turns * (largest > max(0.03 * largest.max(), FRICTION_NM))


def joint_compliance(
    session: Session, rng: Rng, *, joints: Array | None = None, law: str = "joint_compliance"
) -> Cause:
    """Gears that yield: all joints that bear anything or, half of the time, one or two."""
    largest, loaded = _largest(session), _loaded(session)
    way = torques(session, session.plain) / np.sqrt(
        largest * largest.max()
    )  # small gears turn less by their small loads
    share = loaded * rng.uniform(0.5, 1.5, len(loaded)) if joints is None else loaded * joints
    if joints is None and rng.random() < 0.5:
        share = carriers(session, rng, way, most=2, allowed=loaded)

    def known(size: float) -> dict[str, float]:
        return {
            f"joint_compliance.J{j + 1}.c_rad_per_nm": size * 1e-4 * share[j] / np.sqrt(largest[j] * largest.max())
            for j in np.flatnonzero(session.make.turns)
        }

    # where masses are wrong in the sheet, so is the compliance that fits: its value is not known
    return joint_cause(
        law,
        lambda s, here: share * torques(s, here) / np.sqrt(largest * largest.max()),
        ("joint_compliance",),
        known=known if session.mass_factor == 1.0 else None,
    )


def hardening_spring(session: Session, rng: Rng) -> Cause:
    """A gear that stiffens: the deflection goes with the square of the torque, signed."""
    largest = _largest(session)
    share = carriers(session, rng, (torques(session, session.plain) / largest), most=1, allowed=_loaded(session))

    def way(s: Session, here: Stance) -> Array:
        part = torques(s, here) / largest
        return share * part * np.abs(part)

    return joint_cause("hardening_spring", way, ("nonlinear_stiffness",))


def gravity_backlash(session: Session, rng: Rng) -> Cause:
    """Play that weight takes up."""
    largest = _largest(session)

    def way(s: Session, here: Stance) -> Array:
        return np.tanh(torques(s, here) / (0.01 * largest))

    share = carriers(session, rng, way(session, session.plain), most=1, allowed=_loaded(session))
    return joint_cause("gravity_backlash", lambda s, here: share * way(s, here), ("gravity_backlash",))


def counterbalance(session: Session, rng: Rng) -> Cause:
    """A spring between the column and the upper arm turns joint 2 through its gear: tension times lever.

    Its length follows from two pivots; at rest length L0 it pulls not. It holds up the arm at its extended side.
    """
    joint = 1 if session.make.turns[1] else int(np.argmax(session.make.turns))
    far, near = 1.0, rng.uniform(0.25, 0.6)  # pivots' distances from the axis
    rest = rng.uniform(0.0, 0.9) * (far - near)
    load = session.plain.torque(joint)
    upright = session.q[np.argmin(np.abs(load)), joint]
    phi = session.q[:, joint] - upright
    length = np.sqrt(far**2 + near**2 - 2.0 * far * near * np.cos(np.pi - phi))
    torque = (length - rest) / length * far * near * np.sin(phi)
    torque *= -np.sign(np.sum(torque * load)) / max(np.abs(torque).max(), 1e-9)
    way = np.zeros_like(session.q)
    way[:, joint] = torque
    return joint_cause("counterbalance", lambda s, here: way, ("counterbalance",))


def payload_step(session: Session, rng: Rng) -> Cause:
    """A part is taken up at a pose, and sometimes put down again, unsaid. Only a soft arm shows it."""
    carried = period(session, rng, back=rng.random() < 0.4)
    place = session.make.place(session.make.n - 1, session.make.payload_com_mm)
    place = place + 30.0 * rng.standard_normal(3)

    def load(s: Session, size: float) -> Load:
        return Load(s.make.n - 1, 0.1 * size * s.make.payload_kg * carried, place)

    return Cause("payload_step", ("payload_step",), load=load)


def period(session: Session, rng: Rng, *, back: bool = False, late: bool = False) -> Array:
    """(N,) 1 from a pose on, else 0; `back`: until a later pose. `late`: over the last six to ten poses alone."""
    at = np.arange(session.count)
    first = int(rng.integers(session.count // 5, 3 * session.count // 5))
    if late:
        first = session.count - int(rng.integers(6, 11))
    until = first + int(rng.integers(session.count // 6, session.count // 3)) if back else session.count
    return ((at >= first) & (at < until)).astype(float)


def link_bending(session: Session, rng: Rng) -> Cause:
    """Links bend between joint and end by the moment at each place (Euler and Bernoulli), integrated along the link."""
    n = session.make.n
    long = np.linalg.norm(session.build.end - session.build.through, axis=1)
    share = (long > 120.0) * session.make.turns * rng.uniform(0.5, 1.5, n)
    if not share.any():
        share = np.zeros(n)

    def flex(s: Session, here: Stance, size: float) -> Flex:
        bend, give = np.zeros((s.count, n, 3)), np.zeros((s.count, n, 3))
        for j in np.flatnonzero(share):
            turn, shift = bent_link(s, here, int(j))
            bend[:, j] = size * 1e-6 * share[j] * here.body[j].back(turn)
            give[:, j] = size * 1e-6 * share[j] * here.body[j].back(shift)
        return replace(s.still, bend=bend, give=give)

    return Cause("link_bending", ("link_bending",), flex)


def bent_link(session: Session, here: Stance, j: int) -> tuple[Array, Array]:
    """Turn (N, 3) and shift (N, 3) mm of link j's end, base frame, for a flexibility L / EI of 1 rad/Nm."""
    root, end = here.body[j].of(session.build.through[j]), here.body[j].of(session.build.end[j])
    span = end - root
    along = span / np.linalg.norm(span, axis=1)[:, None]
    weight = session.mass_factor * session.make.mass_kg[j] * session.gravity
    turn, shift = np.zeros_like(span), np.zeros_like(span)
    for node, part in zip(NODES, WEIGHTS, strict=True):
        at = root + node * span
        outer = np.cross(0.5 * (1.0 - node) * span, (1.0 - node) * weight) / 1000.0
        moment = here.moment_about(at, j + 1) + outer
        moment = moment - np.sum(moment * along, axis=1)[:, None] * along
        turn = turn + part * moment
        shift = shift + part * np.cross(moment, end - at)
    return turn, shift


def _foot(law: str, when: Array, rng: Rng, names: tuple[str, ...]) -> Cause:
    soft = np.append(rng.uniform(0.4, 1.6, 2), 0.0)

    def flex(s: Session, here: Stance, size: float) -> Flex:
        moment = here.moment_about(np.zeros((s.count, 3)), 0)
        return replace(s.still, foot_turn=size * 1e-6 * soft * when[:, None] * moment)

    return Cause(law, names, flex)


def base_compliance(session: Session, rng: Rng) -> Cause:
    """A foot that yields to the arm's moment."""
    return _foot("base_compliance", np.ones(session.count), rng, ("base_compliance",))


def base_loosening(session: Session, rng: Rng) -> Cause:
    """A foot whose bolts give way at a pose."""
    return _foot("base_loosening", period(session, rng), rng, ("base_loosening",))


def tool_down(session: Session, here: Stance) -> Array:
    """(N, 3) where down is, in the last link's home axes."""
    return here.body[-1].back(session.gravity / np.linalg.norm(session.gravity))


def tool_sag(session: Session, rng: Rng) -> Cause:
    """A slender tool: it yields across its own axis, not along it."""
    axis = session.build.axis[-1]

    def flex(s: Session, here: Stance, size: float) -> Flex:
        down = tool_down(s, here)
        return replace(s.still, tool=0.05 * size * (down - (down @ axis)[:, None] * axis))

    return Cause("tool_sag", ("tool_sag",), flex)
