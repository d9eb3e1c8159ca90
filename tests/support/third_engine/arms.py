"""Makes of arms as a data sheet has them, and the same arm as screws in its home position."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.support.third_engine.screws import Array, Build, Motion

DOWN = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Make:
    """A make of arm. Rows are a mm, alpha deg, d mm, theta deg, beta deg; the last is the tool."""

    name: str
    rows: tuple[tuple[float, ...], ...]
    limits: tuple[tuple[float, float], ...]  # deg, or mm where it slides
    mass_kg: tuple[float, ...]
    com_mm: tuple[tuple[float, ...], ...]  # in each link's frame
    payload_kg: float  # the most
    slides: tuple[bool, ...]
    gravity: tuple[float, float, float] = DOWN
    gear: float = 100.0
    tool_com_mm: tuple[float, float, float] = (10.0, 0.0, 45.0)
    payload_com_mm: tuple[float, float, float] = (25.0, -15.0, 80.0)

    @property
    def n(self) -> int:
        return len(self.slides)

    @property
    def tool_kg(self) -> float:
        return 0.15 * self.payload_kg

    @property
    def reach_mm(self) -> float:
        travel = sum(high - low for (low, high), slide in zip(self.limits, self.slides, strict=True) if slide)
        return sum(abs(row[0]) + abs(row[2]) for row in self.rows) + travel

    @property
    def turns(self) -> Array:
        """1 where a joint turns, 0 where it slides."""
        return 1.0 - np.array(self.slides, dtype=float)

    def frames(self) -> list[Motion]:
        """Home position of each row's frame, the base's first."""
        out = [Motion.none(1)]
        x, y, z = np.eye(3)
        for a, alpha, d, theta, beta in self.rows:
            turns = [
                Motion.about(np.radians([angle]) * axis[None], np.zeros(3))
                for angle, axis in ((theta, z), (alpha, x), (beta, y))
            ]
            out.append(out[-1] @ turns[0] @ Motion.along(np.array([[a, 0.0, d]])) @ turns[1] @ turns[2])
        return out

    def place(self, link: int, in_link_mm: tuple[float, ...]) -> Array:
        """Home position (3,) of a point of a link's frame."""
        return self.frames()[link + 1].of(np.array([in_link_mm]))[0]

    def build(self) -> Build:
        """The arm exactly as the data sheet says."""
        frames = self.frames()
        n = self.n
        return Build(
            axis=np.array([frame.pointing(np.array([0.0, 0.0, 1.0]))[0] for frame in frames[:n]]),
            through=np.array([frame.shift[0] for frame in frames[:n]]),
            end=np.array([frame.shift[0] for frame in frames[1 : n + 1]]),
            cross=np.array([frame.pointing(np.array([1.0, 0.0, 0.0]))[0] for frame in frames[1 : n + 1]]),
            slides=self.slides,
            zero=np.zeros(n),
            tool=frames[-1].shift[0],
        )


def erring(build: Build, rng: np.random.Generator, length_mm: float, angle_rad: float) -> Build:
    """The arm as it was really built: axes tilted and shifted, zeros and tool off."""
    n = build.n
    turn = angle_rad * rng.standard_normal((n, 3))
    return replace(
        build,
        axis=Motion.about(turn, np.zeros(3)).pointing(build.axis),
        through=build.through + length_mm * rng.standard_normal((n, 3)),
        zero=build.zero + np.where(build.slides, length_mm, angle_rad) * rng.standard_normal(n),
        tool=build.tool + length_mm * rng.standard_normal(3),
    )


def _make(
    name: str,
    rows: list[tuple[float, float, float, float]],
    limits: list[tuple[float, float]],
    mass_kg: list[float],
    payload_kg: float,
    tool: tuple[float, float, float, float] = (35.0, 0.0, 105.0, 0.0),
    slides: str = "",
    gravity: tuple[float, float, float] = DOWN,
    gear: float = 100.0,
) -> Make:
    """A make whose links have their centres of mass half way back to their joints and a little beside."""
    com = []
    for k, (a, alpha, d, _) in enumerate(rows):
        back = np.array([0.0, np.sin(np.radians(alpha)), np.cos(np.radians(alpha))])
        beside = 0.02 * (abs(a) + abs(d) + 50.0) * np.array([np.sin(k + 1.0), np.cos(2.0 * k), np.sin(3.0 * k)])
        com.append(tuple(float(v) for v in np.array([-0.5 * a, 0.0, 0.0]) - 0.4 * d * back + beside))
    return Make(
        name=name,
        rows=tuple((*row, 0.0) for row in (*rows, tool)),
        limits=tuple(limits),
        mass_kg=tuple(mass_kg),
        com_mm=tuple(com),
        payload_kg=payload_kg,
        slides=tuple(kind == "P" for kind in (slides or "R" * len(rows))),
        gravity=gravity,
        gear=gear,
    )


_WIDE = (-165.0, 165.0)
SMALL = _make(
    "small 6R",
    [(0, -90, 290, 0), (270, 0, 0, -90), (70, -90, 0, 0), (0, 90, 302, 0), (0, -90, 0, 0), (0, 0, 72, 0)],
    [_WIDE, (-100, 100), (-100, 65), (-155, 155), (-115, 115), (-170, 170)],
    [6.2, 5.8, 4.4, 2.7, 1.3, 0.4],
    3.0,
)
COBOT_7 = _make(
    "cobot 7R",
    [
        (81, -90, 317, 0),
        (0, 90, 192.5, 0),
        (0, -90, 400, 0),
        (0, 90, -168.5, 0),
        (0, -90, 400, 0),
        (0, 90, 136.3, 0),
        (0, 0, 133.75, 0),
    ],
    [_WIDE, (-170, 10), _WIDE, (-160, 160), (-165, 165), (-160, 160), _WIDE],
    [5.3, 4.5, 2.9, 2.5, 1.7, 1.9, 0.5],
    4.0,
    gear=160.0,
)
HEAVY = _make(
    "200 kg arm",
    [(330, -90, 645, 0), (1150, 0, 0, -90), (115, -90, 0, 0), (0, 90, 1220, 0), (0, -90, 0, 0), (0, 0, 215, 0)],
    [(-150, 150), (-50, 75), (-90, 60), _WIDE, (-115, 115), _WIDE],
    [420.0, 290.0, 210.0, 110.0, 52.0, 28.0],
    200.0,
    tool=(150.0, 0.0, 380.0, 0.0),
    gear=220.0,
)
SCARA = _make(
    "SCARA",
    [(325, 0, 210, 0), (275, 180, 40, 0), (0, 0, 50, 0), (0, 0, 30, 0)],
    [(-130, 130), (-140, 140), (0, 200), _WIDE],
    [8.0, 5.0, 2.0, 0.6],
    5.0,
    tool=(90.0, 0.0, 80.0, 25.0),
    slides="RRPR",
    gear=80.0,
)
GANTRY = _make(
    "gantry with wrist",
    [(0, -90, 250, -90), (0, -90, 220, -90), (0, 0, 200, 0), (0, -90, 160, 0), (0, 90, 0, 0), (0, 0, 130, 0)],
    [(0, 1800), (0, 1200), (0, 800), _WIDE, (-110, 110), _WIDE],
    [180.0, 95.0, 40.0, 8.0, 4.5, 2.0],
    12.0,
    tool=(120.0, 0.0, 150.0, 0.0),
    slides="PPPRRR",
)
INVERTED = _make(
    "cobot 6R from the ceiling",
    [(0, -90, 145.1, 0), (429, 0, 0, -90), (411.5, 0, 0, 0), (0, 90, -122.2, 90), (0, -90, 106, 0), (0, 0, 114.4, 0)],
    [_WIDE, (-125, 125), (-145, 145), _WIDE, (-160, 160), _WIDE],
    [6.0, 10.2, 4.6, 1.8, 1.7, 0.9],
    6.0,
    gravity=(0.0, 0.0, 9.81),
)
_third = GANTRY.build().axis[2]
GANTRY = replace(GANTRY, gravity=tuple(float(9.81 * v) for v in np.round(_third, 9)))
FIXED = (SMALL, COBOT_7, HEAVY, SCARA, GANTRY, INVERTED)


def random_six(rng: np.random.Generator) -> Make:
    """A make of six joints, no two of them parallel."""
    rows, mass_kg = [], []
    for j in range(6):
        length = float(rng.uniform(180.0, 480.0) if j < 3 else rng.uniform(70.0, 180.0))
        alpha = float(rng.choice([-1.0, 1.0]) * rng.uniform(60.0, 110.0))
        share = float(rng.uniform(0.1, 0.9))
        rows.append((share * length, alpha, (1.0 - share) * length, float(rng.uniform(-180.0, 180.0))))
        mass_kg.append(float(11.0 * 0.62**j * rng.uniform(0.7, 1.3)))
    return _make("random 6R", rows, [(-140.0, 140.0)] * 6, mass_kg, 5.0)


def draw_make(turn: int, rng: np.random.Generator) -> Make:
    """The makes in turn; a quarter of those that stand on the floor hang on a wall."""
    make = random_six(rng) if turn % 7 == 6 else FIXED[turn % 7]
    wall = make.gravity == DOWN and make.name not in ("200 kg arm", "SCARA") and rng.random() < 0.25
    return replace(make, gravity=(9.81, 0.0, 0.0)) if wall else make
