"""Kinds of scans of the mesh ray caster, by name: which jig, scanner and surroundings each draws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib.jig import Jig
from tests.support.mesh_parts import JigShape
from tests.support.mesh_scanners import Scanner
from tests.support.mesh_scene import MeshScan, Scene, scan_of

Draw = Callable[[np.random.Generator], tuple[JigShape, Scanner, Scene]]


@dataclass(frozen=True)
class Kind:
    """A kind of scan: what its jig, scanner and surroundings are drawn from."""

    draw: Draw
    told_sigma: bool = True  # whether the finder is told the scanner's sigma

    def scan(self, name: str, seed: int) -> tuple[MeshScan, Jig, float | None]:
        """Scan number `seed` of this kind, with what the finder is told: the jig and perhaps the scanner's sigma."""
        rng = np.random.default_rng([seed, *name.encode()])
        shape, scanner, scene = self.draw(rng)
        made = scan_of(shape, scanner, scene, rng)
        return made, Jig(edge_mm=shape.edge), scanner.sigma if self.told_sigma else None


def scanner_of(kind: str, edge: float, rng: np.random.Generator) -> Scanner:
    """A scanner of some kind with a jig of that edge well in view."""
    away = edge * rng.uniform(8, 15)
    common = Scanner(kind, distance=away, field=edge * rng.uniform(2.2, 4.5))
    small = edge / 60
    if kind == "structured light":
        return replace(
            common, points=int(10 ** rng.uniform(4.3, 5.3)), sigma=small * rng.uniform(0.01, 0.05),
            quantum=rng.choice([0, 0.01, 0.02]), baseline=rng.uniform(100, 300), origin_away=rng.uniform(0, 60),
        )  # fmt: skip
    if kind == "laser lines":
        return replace(
            common, points=int(10 ** rng.uniform(4.6, 5.5)), sigma=small * rng.uniform(0.008, 0.03), quantum=0.01,
            baseline=rng.uniform(0.15, 0.4) * away, line_step=rng.uniform(0.5, 1.0), origin_away=rng.uniform(0, 60),
        )  # fmt: skip
    if kind == "time of flight":
        return replace(common, points=int(10 ** rng.uniform(4.3, 5.2)), sigma=rng.uniform(0.3, 1.0), quantum=0.05)
    return replace(common, points=int(10 ** rng.uniform(4.3, 5.0)), sigma=small * rng.uniform(0.02, 0.06), quantum=0.0)


def _jig(rng: np.random.Generator, **flaws: float) -> JigShape:
    """An edge between 30 and 120 mm, a small bevel, tips cut a little."""
    edge = float(rng.uniform(30, 120))
    usual = JigShape(edge, chamfer=rng.uniform(0.2, 1.0) * edge / 60, tip_cut=rng.uniform(0, 0.05) * edge)
    return replace(usual, **flaws)  # type: ignore[arg-type]


def _with(scanner: str, scene: Scene = Scene(), *, at_edge: float | None = None, **flaws: float) -> Draw:  # noqa: B008
    def draw(rng: np.random.Generator) -> tuple[JigShape, Scanner, Scene]:
        shape = _jig(rng, **flaws)
        if at_edge is not None:
            shape = replace(shape, edge=at_edge)
        return shape, scanner_of(scanner, shape.edge, rng), scene

    return draw


def _changed(draw: Draw, **scanner: float | str) -> Draw:
    def changed(rng: np.random.Generator) -> tuple[JigShape, Scanner, Scene]:
        shape, usual, scene = draw(rng)
        return shape, replace(usual, **scanner), scene  # type: ignore[arg-type]

    return changed


def _plate(height_mm: tuple[float, float]) -> Draw:
    def draw(rng: np.random.Generator) -> tuple[JigShape, Scanner, Scene]:
        shape = _jig(rng, plate=float(rng.uniform(*height_mm)))
        return shape, scanner_of("structured light", shape.edge, rng), Scene()

    return draw


def _in_shadow(kind: str) -> Draw:
    """A jig with one face out of sight of the other eye, which is far to the side."""

    def draw(rng: np.random.Generator) -> tuple[JigShape, Scanner, Scene]:
        shape, scanner, scene = _with(kind, Scene("in shadow"))(rng)
        return shape, replace(scanner, baseline=0.4 * scanner.distance), scene

    return draw


def _steep(incidence_deg: float) -> Draw:
    """A face a few pixels wide, of a jig without bevels, by a scanner whose pixels mix with their neighbours."""

    def draw(rng: np.random.Generator) -> tuple[JigShape, Scanner, Scene]:
        scanner = Scanner(points=12_000, field=150.0, heavy_tails=False, quantum=0.0, patches=0)
        return JigShape(), scanner, Scene(workshop=False, steepest_deg=incidence_deg)

    return draw


def _anything(rng: np.random.Generator) -> tuple[JigShape, Scanner, Scene]:
    """All at once."""
    edge = float(rng.uniform(30, 120))
    kind = str(rng.choice(["structured light", "laser lines", "time of flight", "fused mesh"]))
    if kind == "time of flight":
        edge = max(edge, 60.0)
    shape = JigShape(
        edge,
        chamfer=float(rng.uniform(0, 2)) * edge / 60,
        tip_cut=float(rng.uniform(0, 0.1)) * edge,
        holes=int(rng.integers(0, 3)),
        sticker=float(rng.choice([0, rng.uniform(0.1, 0.3)])),
    )
    scene = Scene(bracket=bool(rng.random() < 0.4), cable=bool(rng.random() < 0.3))
    return shape, scanner_of(kind, edge, rng), scene


_LIGHT, _LINES, _FLIGHT, _FUSED = "structured light", "laser lines", "time of flight", "fused mesh"
KINDS: dict[str, Kind] = {
    "light": Kind(_with(_LIGHT)),
    "light, sigma untold": Kind(_with(_LIGHT), told_sigma=False),
    "light, edge 30": Kind(_with(_LIGHT, at_edge=30.0)),
    "light, edge 120": Kind(_with(_LIGHT, at_edge=120.0)),
    "light, 5000 points": Kind(_changed(_with(_LIGHT), points=5000)),
    "light, 1M points": Kind(_changed(_with(_LIGHT), points=1_000_000)),
    "light, steps of 0.05": Kind(_changed(_with(_LIGHT), quantum=0.05)),
    "light, NaN": Kind(_changed(_with(_LIGHT), no_depth="nan")),
    "light, zeros": Kind(_changed(_with(_LIGHT), no_depth="zero")),
    "chamfer 2 mm": Kind(_with(_LIGHT, chamfer=2.0)),
    "no chamfer": Kind(_with(_LIGHT, chamfer=0.0, tip_cut=0.0)),
    "tips cut 6 mm": Kind(_with(_LIGHT, at_edge=60.0, tip_cut=6.0)),
    "screw holes": Kind(_with(_LIGHT, holes=3)),
    "sticker 0.1": Kind(_with(_LIGHT, sticker=0.1)),
    "sticker 0.3": Kind(_with(_LIGHT, sticker=0.3)),
    "base plate flush": Kind(_plate((0, 0))),
    "base plate +-1 mm": Kind(_plate((-1, 1))),
    "base plate 3-10 mm": Kind(_plate((3, 10))),
    "bracket": Kind(_with(_LIGHT, Scene(bracket=True))),
    "cable": Kind(_with(_LIGHT, Scene(cable=True))),
    "lines": Kind(_with(_LINES)),
    "lines, sigma untold": Kind(_with(_LINES), told_sigma=False),
    "lines, bracket": Kind(_with(_LINES, Scene(bracket=True))),
    "flight": Kind(_with(_FLIGHT, at_edge=100.0)),
    "flight, edge 60": Kind(_with(_FLIGHT, at_edge=60.0)),
    "flight, sigma untold": Kind(_with(_FLIGHT, at_edge=100.0), told_sigma=False),
    "fused": Kind(_with(_FUSED)),
    "fused, sigma untold": Kind(_with(_FUSED), told_sigma=False),
    "fused, views off": Kind(_changed(_with(_FUSED), registration=0.03)),
    "fused, origin away": Kind(_changed(_with(_FUSED), origin_away=1500.0)),
    "anything": Kind(_anything),
    "no jig, light": Kind(_with(_LIGHT, Scene("absent", bracket=True))),
    "no jig, flight": Kind(_with(_FLIGHT, Scene("absent", bracket=True))),
    "no jig, fused": Kind(_with(_FUSED, Scene("absent", bracket=True))),
    "cube instead": Kind(_with(_LIGHT, Scene("cube instead"))),
    "cube, flight": Kind(_with(_FLIGHT, Scene("cube instead"), at_edge=60.0)),
    "turned away, light": Kind(_with(_LIGHT, Scene("turned away", bracket=True))),
    "turned away, lines": Kind(_with(_LINES, Scene("turned away", bracket=True))),
    "turned away, flight": Kind(_with(_FLIGHT, Scene("turned away"), at_edge=60.0)),
    "in shadow, light": Kind(_in_shadow(_LIGHT)),
    "in shadow, lines": Kind(_in_shadow(_LINES)),
    "steep, 72 deg": Kind(_steep(72.0)),
    "steep, 75 deg": Kind(_steep(75.0)),
    "steep, 78 deg": Kind(_steep(78.0)),
    "covered face": Kind(_with(_LIGHT, Scene("covered"))),
}
