"""The classes of cases: what is hidden, in which session, and what the sheet says of it."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tests.support.third_engine import inventions, joint_laws, load_laws, order_laws
from tests.support.third_engine.arms import Make, draw_make
from tests.support.third_engine.instruments import INSTRUMENTS, covariances, draw_noise
from tests.support.third_engine.screws import Array
from tests.support.third_engine.session import Cause, Session, draw_session

Draw = Callable[[Session, np.random.Generator], Cause]
Rng = np.random.Generator


def _laws(module: object, *names: str) -> dict[str, Draw]:
    return {name: getattr(module, name) for name in names}


CATALOGUE = {
    **_laws(load_laws, "joint_compliance", "link_bending", "base_compliance", "gravity_backlash", "tool_sag"),
    **_laws(joint_laws, "transmission_error", "encoder_eccentricity", "high_harmonic", "strain_wave", "joint_scale"),
    **_laws(joint_laws, "asymmetric_scale", "joint_coupling", "joint_dent", "backlash"),
    **_laws(order_laws, "thermal_growth", "scanner_drift", "scanner_step", "joint_step", "target_step", "warm_up"),
    **_laws(load_laws, "base_loosening"),
}
"""Laws that the catalogue has, as it says them."""
KNOCKS = _laws(order_laws, "joint_knocked_and_put_back", "late_joint_step", "target_step", "scanner_step", "joint_step")
BEAMS = _laws(order_laws, "beam_wander", "beam_drift", "settling_stand")
FRICTION = _laws(joint_laws, "dahl_friction", "play_operator")
DAYS = _laws(order_laws, "remastered", "other_seat", "other_air")
CLOSE_ORDERS = ((2, 3), (6, 7), (1, 2), (3, 4), (9, 10), (4, 5))
UNSAID = _laws(load_laws, "payload_step", "counterbalance")
"""Torques that only a soft joint shows: their cases have `joint_compliance` before them."""
LAWS: dict[str, Draw] = {
    **CATALOGUE,
    **KNOCKS,
    **BEAMS,
    **FRICTION,
    **DAYS,
    **UNSAID,
    **_laws(order_laws, "lagging_growth", "motor_heat", "link_step"),
    **_laws(load_laws, "hardening_spring"),
    **_laws(joint_laws, "following"),
    **inventions.INVENTIONS,
    **{
        f"close_orders_{k}": lambda s, rng, orders=orders: joint_laws.waves(s, rng, orders, "close_orders", most=1)
        for k, orders in enumerate(CLOSE_ORDERS)
    },
}
MIXED = (
    *("joint_compliance", "transmission_error", "backlash", "joint_step", "scanner_drift", "thermal_growth"),
    *("base_compliance", "tool_sag", "dahl_friction", "motor_heat", "link_step", "payload_step", "high_harmonic"),
)
"""Of these mixtures are made."""


@dataclass(frozen=True)
class Plan:
    """What is hidden in a case, and how its session differs from others."""

    laws: tuple[str, ...] = ()
    setups: int = 1
    tour: bool = False  # each pose near the one before
    chosen_sides: bool = False
    one_attitude: bool = False
    narrow: float = 1.0
    mass_factor: float = 1.0
    sister: str = ""  # "link" or "flange": the table of another make of the same family
    visible: float = 3.5  # median size of a cause, in sigmas
    undecidable: bool = False  # by these data: an open set that holds the truth is right too


@dataclass(frozen=True)
class Case:
    """A case; its fields are the seed of all that is drawn for it."""

    kind: str
    number: int
    seed: int = 0

    @property
    def key(self) -> list[int]:
        return [self.seed, self.number, zlib.crc32(self.kind.encode()), 3]


def _turn(laws: dict[str, Draw], k: int, **more: object) -> Plan:
    return Plan((list(laws)[k % len(laws)],), **more)  # type: ignore[arg-type]


_DECEPTIVE = (
    Plan(("joint_compliance",), mass_factor=1.3),
    Plan(("lagging_growth",)),
    Plan(("settling_stand",)),
    Plan(("transmission_error",), narrow=0.4, undecidable=True),
    Plan(("hardening_spring",)),
    Plan(("backlash",), tour=True),
    Plan(("link_bending",), mass_factor=0.75),
    Plan(("late_joint_step",)),
    Plan(("encoder_eccentricity",), narrow=0.5, undecidable=True),
    Plan(("joint_step",), tour=True),
)
_SISTERS = (Plan(), Plan(("joint_compliance",)), Plan(("transmission_error",)))
_GRID = ("", "joint_compliance", "transmission_error", "scanner_drift", "joint_step", "thermal_growth")


def _friction(k: int, rng: Rng) -> Plan:
    return replace(_turn(FRICTION, k), laws=(*_turn(FRICTION, k).laws, *(("joint_compliance",) if k % 3 == 2 else ())))


def _mixture(count: int) -> Callable[[int, Rng], Plan]:
    def plan(k: int, rng: Rng) -> Plan:
        laws = [str(name) for name in rng.choice(MIXED, count, replace=False)]
        if "payload_step" in laws and "joint_compliance" not in laws:  # nobody sees it on a stiff arm
            laws[laws.index("payload_step")] = "joint_compliance"
            laws = [*[law for law in laws if law != "joint_compliance"], "joint_compliance", "payload_step"][-count:]
        return Plan(tuple(sorted(laws, key=lambda law: law in UNSAID)))

    return plan


CLASSES: dict[str, tuple[Callable[[int, Rng], Plan], int]] = {
    "nothing": (lambda k, rng: Plan(tour=k % 3 == 1, setups=1 + k % 2), 12),
    "catalogue": (lambda k, rng: _turn(CATALOGUE, k), 21),
    "deceptive": (lambda k, rng: _DECEPTIVE[k % len(_DECEPTIVE)], 10),
    "knocks": (lambda k, rng: _turn(KNOCKS, k), 10),
    "payload unsaid": (lambda k, rng: Plan(("joint_compliance", "payload_step")), 8),
    "bent link": (lambda k, rng: Plan(("link_step",), visible=2.2), 8),
    "counterbalance": (lambda k, rng: Plan(("joint_compliance", "counterbalance"), undecidable=True), 8),
    "path friction": (_friction, 8),
    "motor heat": (lambda k, rng: Plan(("motor_heat",), tour=k % 2 == 1), 8),
    "beam": (lambda k, rng: _turn(BEAMS, k), 9),
    "commanded": (lambda k, rng: Plan(("following",), tour=k % 2 == 1), 8),
    "sister table": (lambda k, rng: replace(_SISTERS[k // 2 % 3], sister=("link", "flange")[k % 2]), 8),
    "grid": (lambda k, rng: Plan((_GRID[k % 6],) if k % 6 else (), one_attitude=True, undecidable=True), 6),
    "wrong day": (lambda k, rng: _turn(DAYS, k, setups=3), 9),
    "close orders": (lambda k, rng: Plan((f"close_orders_{k % len(CLOSE_ORDERS)}",)), 6),
    "invented": (lambda k, rng: _turn(inventions.INVENTIONS, k), 10),
    "mixture of 2": (_mixture(2), 10),
    "mixture of 3": (_mixture(3), 8),
}
"""What is hidden, and how many of each the standard run has."""


def cases(per_class: int | None = None, seed: int = 0, only: tuple[str, ...] = ()) -> list[Case]:
    """All cases of a run, or those of some classes."""
    return [
        Case(kind, k, seed)
        for kind, (_, count) in CLASSES.items()
        if not only or kind in only
        for k in range(count if per_class is None else per_class)
    ]


@dataclass(frozen=True, eq=False)
class Simulated:
    """A measured session and its truth."""

    case: Case
    plan: Plan
    session: Session
    hidden: tuple[tuple[Cause, float], ...]
    sigmas: tuple[float, ...]  # visible size of each cause beside those before it, over the noise
    instrument: str
    declared_mm: float
    pose: Array  # (M,) of each reading
    reading_mm: Array  # (M, 3)
    covariance_mm2: Array | None  # (M, 3, 3), where the sheet has it
    freed_mm: Array = field(repr=False)  # (M, 3) the same readings without the causes
    columns: frozenset[str]  # conditions that the sheet has
    role: tuple[str, ...]

    @property
    def known(self) -> dict[str, float]:
        """True values of parameters, by calib's names."""
        return {
            name: value
            for cause, size in self.hidden
            if cause.known is not None
            for name, value in cause.known(size).items()
        }


_NEEDS = {
    "backlash": "approach",
    "following": "time_s",
    "thermal_growth": "temperature_c",
    "lagging_growth": "temperature_c",
    **dict.fromkeys(
        ("scanner_drift", "settling_stand", "beam_drift", "motor_heat", "warm_up", "sunlit_link"), "time_s"
    ),
}
_NOT_WITH = {"warm_up": "temperature_c", "motor_heat": "temperature_c"}


MOST = {
    **dict.fromkeys(("thermal_growth", "lagging_growth"), 2.4),  # in 1e-5 / K: aluminium
    **dict.fromkeys(("high_harmonic", "strain_wave", "close_orders_1", "close_orders_4"), 8.0),  # 0.8 mrad
    **dict.fromkeys(("beam_wander", "beam_drift", "other_air", "hot_plume", "mirror_eccentricity"), 5.0),  # 0.5 mrad
    **dict.fromkeys(("sunlit_link", "payload_step"), 7.0),  # 0.7 mrad; 70 % of what the arm may carry
    "warm_up": 12.0,  # 1.2e-3 of all lengths
    "brake_slip": 15.0,  # 1.5 mrad
}
"""The largest sizes of causes that are still those of a real arm; 30 (3 mrad of a joint, 3 mm) of others."""


def simulate(case: Case) -> Simulated:
    """Draw sessions and causes until every cause can be seen, and measure."""
    rng = np.random.default_rng(case.key)
    plan = CLASSES[case.kind][0](case.number + 7 * case.seed, rng)
    for attempt in range(80):
        make = draw_make(case.number + 3 * case.seed + attempt, rng)
        session = _session(plan, make, rng)
        if session is None:
            continue
        sigma_mm = float(np.exp(rng.uniform(np.log(0.02), np.log(0.07))))
        hidden = _hidden(plan, session, sigma_mm, rng)
        if hidden is not None:
            return _measured(case, plan, session, hidden, sigma_mm, rng)
    raise RuntimeError(f"{case}: no arm shows {plan.laws}")


def _session(plan: Plan, make: Make, rng: Rng) -> Session | None:
    if plan.one_attitude and (any(make.slides) or make.n < 6):
        return None
    few, many = (90, 121) if plan.setups > 1 or len(plan.laws) > 2 else (60, 111)
    session = draw_session(
        make,
        rng,
        count=int(rng.integers(few, many)),
        setups=plan.setups,
        payload=bool(rng.random() < 0.6),
        tour=plan.tour or (not plan.one_attitude and bool(rng.random() < 0.15)),
        chosen_sides=plan.chosen_sides or bool("backlash" in plan.laws and not plan.tour and rng.random() < 0.5),
        one_attitude=plan.one_attitude,
        narrow=plan.narrow,
    )
    return None if session is None else replace(session, mass_factor=plan.mass_factor)


def _hidden(plan: Plan, session: Session, sigma_mm: float, rng: Rng) -> tuple[tuple[Cause, float], ...] | None:
    """The causes with their sizes; None where one of them cannot be seen, or not as a real one."""
    hidden: list[tuple[Cause, float]] = []
    unsaid = bool(set(plan.laws) & set(UNSAID))
    for law in plan.laws:
        visible = float(np.clip(plan.visible * np.exp(0.6 * rng.standard_normal()), 1.5, 12.0))
        if law == "joint_compliance" and unsaid:
            joints = rng.uniform(0.6, 1.4, session.make.n)
            cause, visible = load_laws.joint_compliance(session, rng, joints=joints), rng.uniform(6.0, 25.0)
            if session.make.name in ("SCARA", "gantry with wrist"):  # no upper arm that weight turns
                return None
        else:
            cause = LAWS[law](session, rng)
        if law == "counterbalance":
            size = hidden[0][1] * rng.uniform(0.3, 0.8)
        elif law == "payload_step":
            size = float(np.exp(rng.uniform(np.log(0.7), np.log(7.0))))  # 7 to 70 % of what the arm may carry
        else:
            size = min(session.size_for(cause, visible * sigma_mm, hidden), MOST.get(law, 30.0))  # nan stays
        if not np.isfinite(size) or not _physical(cause, size):
            return None
        if not 1.4 < session.visible_mm(cause, size, hidden) / sigma_mm < 26.0:
            return None
        hidden.append((cause, size))
    whole = np.linalg.norm(session.reported(hidden) - session.reported(()), axis=1)
    return tuple(hidden) if whole.max() < 0.01 * session.make.reach_mm else None


def _physical(cause: Cause, size: float) -> bool:
    """Whether no gear is softer than the smallest that are made."""
    known = {} if cause.known is None else cause.known(size)
    return all(value < 8e-4 for name, value in known.items() if name.endswith("rad_per_nm"))


def _measured(
    case: Case, plan: Plan, session: Session, hidden: tuple[tuple[Cause, float], ...], sigma_mm: float, rng: Rng
) -> Simulated:
    instrument = INSTRUMENTS[rng.integers(len(INSTRUMENTS))]
    repeats = int(rng.integers(2, 5)) if rng.random() < 0.3 else 1
    pose = np.repeat(np.arange(session.count), repeats)
    exact, free = session.reported(hidden)[pose], session.reported(())[pose]
    covariance = covariances(instrument, exact, sigma_mm)
    noise = draw_noise(covariance, rng)
    truthful = rng.random() < 0.85
    told = truthful and instrument != "plain" and rng.random() < 0.35
    role = np.full(session.count, "train", dtype="<U9")
    role[1 + rng.permutation(session.count - 1)[: round(0.2 * session.count)]] = "test"
    role[0] = "reference"
    likely = {"time_s": 0.85, "temperature_c": 0.5, "approach": 0.65}
    columns = {name for name, chance in likely.items() if rng.random() < chance}
    columns |= {_NEEDS[law] for law in plan.laws if law in _NEEDS}
    columns -= {_NOT_WITH[law] for law in plan.laws if law in _NOT_WITH and "thermal_growth" not in plan.laws}
    sigmas = tuple(session.visible_mm(*hidden[k], hidden[:k]) / sigma_mm for k in range(len(hidden)))
    return Simulated(
        case=case,
        plan=plan,
        session=session,
        hidden=hidden,
        sigmas=sigmas,
        instrument=instrument,
        declared_mm=sigma_mm * (1.0 if truthful else float(rng.uniform(0.9, 1.15))),
        pose=pose,
        reading_mm=exact + noise,
        covariance_mm2=covariance if told else None,
        freed_mm=free + noise,
        columns=frozenset(columns),
        role=tuple(role.tolist()),
    )
