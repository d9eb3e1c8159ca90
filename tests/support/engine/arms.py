"""Arms as makers print them: rows, limits, masses. Angles are degrees in these tables alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class ArmTable:
    """A serial arm: frame j is Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), q in theta, or in d where it slides."""

    name: str
    rows: tuple[Numbers, ...]  # a mm, alpha rad, d mm, theta rad, beta rad; the last is the tool
    slides: tuple[bool, ...]
    low: Numbers  # rad, mm
    high: Numbers
    mass_kg: Numbers | None  # of each link; None: not known
    com_mm: tuple[Numbers, ...]  # in each link's own frame, the one after its row
    tool_kg: float
    tool_com_mm: Numbers  # in the last link's frame
    payload_com_mm: Numbers
    payloads_kg: Numbers
    gravity: Numbers = (0.0, 0.0, -9.81)  # m/s^2 in the base's axes
    gear: float = 100.0

    @property
    def n(self) -> int:
        return len(self.slides)

    @property
    def reach_mm(self) -> float:
        return sum(abs(row[0]) + abs(row[2]) for row in self.rows) + sum(
            high - low for low, high, slide in zip(self.low, self.high, self.slides, strict=True) if slide
        )


def _arm(
    name: str,
    rows: Sequence[Numbers],
    limits: Sequence[tuple[float, float]],
    mass_kg: Numbers,
    com_mm: Sequence[Numbers],
    payload_kg: float,
    *,
    tool: Numbers = (40.0, 0.0, 120.0, 0.0),
    slides: str = "",
    gear: float = 100.0,
) -> ArmTable:
    """Rows are a mm, alpha deg, d mm, theta deg; limits deg, or mm where it slides."""
    kind = tuple(c == "P" for c in (slides or "R" * len(rows)))
    unit = [1.0 if slide else np.pi / 180.0 for slide in kind]
    table = tuple(
        (a, float(np.radians(alpha)), d, float(np.radians(theta)), 0.0) for a, alpha, d, theta in (*rows, tool)
    )
    return ArmTable(
        name=name,
        rows=table,
        slides=kind,
        low=tuple(low * u for (low, _), u in zip(limits, unit, strict=True)),
        high=tuple(high * u for (_, high), u in zip(limits, unit, strict=True)),
        mass_kg=mass_kg,
        com_mm=tuple(com_mm),
        tool_kg=0.2 * payload_kg,
        tool_com_mm=(15.0, 5.0, 50.0),
        payload_com_mm=(30.0, -20.0, 90.0),
        payloads_kg=(0.0, 0.35 * payload_kg, 0.75 * payload_kg),
        gear=gear,
    )


_TURN = (-170.0, 170.0)

UR5E = _arm(
    "UR5e",
    [
        (0, 90, 162.5, 0),
        (-425, 0, 0, 0),
        (-392.2, 0, 0, 0),
        (0, 90, 133.3, 0),
        (0, -90, 99.7, 0),
        (0, 0, 99.6, 0),
    ],
    [_TURN, (-150, 10), (-150, 150), _TURN, _TURN, _TURN],
    (3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
    [(0, -25.6, 1.9), (212.5, 0, 113.4), (150, 0, 26.5), (0, -1.8, 16.3), (0, 1.8, 16.3), (0, 0, -1.2)],
    5.0,
)
UR10E = _arm(
    "UR10e",
    [
        (0, 90, 180.7, 0),
        (-612.7, 0, 0, 0),
        (-571.55, 0, 0, 0),
        (0, 90, 174.15, 0),
        (0, -90, 119.85, 0),
        (0, 0, 116.55, 0),
    ],
    [_TURN, (-150, 10), (-140, 140), _TURN, _TURN, _TURN],
    (7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
    [(21, 0, 27), (380, 0, 158), (240, 0, 68), (0, 7, 18), (0, 7, 18), (0, 0, -26)],
    10.0,
)
IIWA7 = _arm(
    "iiwa7",
    [
        (0, -90, 340, 0),
        (0, 90, 0, 0),
        (0, 90, 400, 0),
        (0, -90, 0, 0),
        (0, -90, 400, 0),
        (0, 90, 0, 0),
        (0, 0, 126, 0),
    ],
    [(-165, 165), (-115, 115), (-165, 165), (-115, 115), (-165, 165), (-115, 115), _TURN],
    (3.45, 3.48, 4.06, 3.48, 2.16, 2.5, 1.2),
    [(0, 70, -30), (0, -40, 60), (0, 130, 30), (0, -35, 70), (0, 120, 25), (0, 0, 30), (0, 0, -20)],
    6.0,
    gear=160.0,
)
HEAVY = _arm(
    "heavy200",
    [
        (350, -90, 675, 0),
        (1150, 0, 0, -90),
        (41, -90, 0, 0),
        (0, 90, 1200, 0),
        (0, -90, 0, 0),
        (0, 0, 215, 0),
    ],
    [(-160, 160), (-40, 80), (-80, 60), _TURN, (-110, 110), _TURN],
    (390.0, 260.0, 240.0, 95.0, 48.0, 26.0),
    [(-180, 120, 40), (-600, 20, 210), (30, 40, 180), (0, -220, 10), (0, 30, 40), (0, 0, -60)],
    200.0,
    tool=(180.0, 0.0, 420.0, 0.0),
    gear=200.0,
)
SCARA = _arm(
    "SCARA",
    [(400, 0, 320, 0), (350, 180, 0, 0), (0, 0, 60, 0), (0, 0, 40, 0)],
    [(-140, 140), (-145, 145), (0, 250), _TURN],
    (9.0, 6.0, 2.5, 0.8),
    [(-190, 0, 30), (-160, 10, -40), (0, 0, -50), (0, 0, -10)],
    6.0,
    slides="RRPR",
    tool=(110.0, 0.0, 90.0, 20.0),
    gear=80.0,
)
FIVE = _arm(
    "five",
    [(60, -90, 350, 0), (480, 0, 0, -60), (420, 0, 0, 40), (0, -90, 20, -60), (0, 0, 150, 0)],
    [(-165, 165), (-70, 80), (-80, 90), (-100, 100), _TURN],
    (14.0, 9.5, 5.0, 2.2, 0.9),
    [(-30, 60, 10), (-260, 0, 40), (-210, 5, 20), (0, 10, 30), (0, 0, -40)],
    8.0,
    tool=(90.0, 0.0, 110.0, 0.0),
)
GANTRY = _arm(
    "gantry",
    [(0, -90, 300, -90), (0, -90, 200, -90), (0, 0, 250, 0), (0, -90, 180, 0), (0, 90, 0, 0), (0, 0, 140, 0)],
    [(0, 1500), (0, 1100), (0, 700), (-165, 165), (-110, 110), _TURN],
    (160.0, 85.0, 42.0, 9.0, 5.0, 2.2),
    [(0, 120, -200), (20, 0, -150), (0, 20, -260), (0, 60, 10), (0, -10, 30), (0, 0, -40)],
    15.0,
    slides="PPPRRR",
    tool=(150.0, 0.0, 160.0, 0.0),
    gear=120.0,
)
RB5 = _arm(
    "RB5",
    [
        (0, -90, 169.2, 0),
        (425, 0, 0, -90),
        (392, 0, 0, 0),
        (0, 90, -110.7, 90),
        (0, -90, 110.7, 0),
        (0, 0, -94.7, 0),
    ],
    [_TURN, (-120, 120), (-150, 150), _TURN, _TURN, _TURN],
    (5.1, 8.0, 4.3, 1.9, 1.7, 0.7),
    [(0, 28, 2), (-220, 0, -105), (-200, 4, -12), (0, 2, 12), (0, -3, -12), (0, 0, 18)],
    5.0,
    tool=(0.0, 0.0, -88.0, 0.0),
)

FIXED = (UR5E, UR10E, IIWA7, HEAVY, SCARA, FIVE, GANTRY, RB5)
GRAVITIES = (
    (0.0, 0.0, -9.81),
    (0.0, 0.0, 9.81),
    (9.81, 0.0, 0.0),
    (0.0, -9.81, 0.0),
    (4.905, 0.0, -8.4957),
)
"""Floor, ceiling, two walls, a slope of 30 deg."""


def random_six(rng: np.random.Generator) -> ArmTable:
    """Six joints anywhere near right angles to each other."""
    rows, limits, masses, centres = [], [], [], []
    for j in range(6):
        length = rng.uniform(150.0, 500.0) if j < 4 else rng.uniform(60.0, 160.0)
        share = rng.uniform(0.2, 1.0)
        alpha = rng.choice([-90.0, 90.0]) + rng.uniform(-25.0, 25.0)
        a, d = share * length, (1.0 - share) * length * rng.choice([-1.0, 1.0])
        rows.append((float(a), float(alpha), float(d), float(rng.uniform(-180.0, 180.0))))
        limits.append((-150.0, 150.0))
        masses.append(float(12.0 * 0.6**j * rng.uniform(0.7, 1.3)))
        centres.append((float(-0.5 * a), float(rng.uniform(-40.0, 40.0)), float(rng.uniform(-40.0, 40.0))))
    return _arm("random6", rows, limits, tuple(masses), centres, 6.0, tool=(80.0, 0.0, 130.0, 30.0))


def draw_arm(number: int, rng: np.random.Generator) -> ArmTable:
    """The arms in turn, mounted on the floor half of the time, else anywhere."""
    turn = number % (len(FIXED) + 1)
    arm = random_six(rng) if turn == len(FIXED) else FIXED[turn]
    gravity = GRAVITIES[0] if rng.random() < 0.5 else GRAVITIES[rng.integers(1, len(GRAVITIES))]
    return replace(arm, gravity=gravity)
