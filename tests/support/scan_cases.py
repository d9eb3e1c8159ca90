"""Kind and unkind scenes of the ray caster in scan_scene.py, by name, for tests of the corner finder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.jig import Jig
from tests.support.scan_scene import (
    SceneScan,
    box_beside,
    cylinder_beside,
    grazing,
    make_scene,
    parallel_planes,
    room,
)
from tests.support.stray_points import clumps, reflections, spread

Make = Callable[[np.random.Generator, int], SceneScan]


@dataclass(frozen=True)
class Case:
    """A kind of scene: how it is made from a generator and a number of rays, and what the finder is given."""

    make: Make
    jig: Jig = Jig()
    told_sigma_mm: float | None = 0.02
    fewest_rays: int = 0  # the case makes no sense with fewer

    def scene(self, name: str, seed: int, rays: int) -> SceneScan:
        """Scene number `seed` of the case: the same whenever it is asked for."""
        rng = np.random.default_rng([seed, rays, *name.encode()])
        return self.make(rng, max(rays, self.fewest_rays))


def _at(incidence_deg: float) -> Make:
    return lambda rng, rays: make_scene(rng, rays, rotation=grazing(rng, incidence_deg))


def _sized(edge_mm: float, distance_mm: float) -> Make:
    return lambda rng, rays: make_scene(rng, rays, edge_mm=edge_mm, distance_mm=distance_mm, field_mm=2.67 * edge_mm)


def _with_strays(added: Callable[[SceneScan, np.random.Generator, float], SceneScan], share: float) -> Make:
    return lambda rng, rays: added(make_scene(rng, rays), rng, share)


_EDGES = (70.0, 110.0, 160.0)
_THREE_EDGES = Jig(edge_mm=(110.0, 70.0, 160.0))  # as a user measures them, one after the other


def _unlike(rectangular: bool, cut_face: float = 1.0) -> Make:
    return lambda rng, rays: make_scene(
        rng,
        rays,
        edge_mm=110.0,
        edges_mm=_EDGES,
        rectangular=rectangular,
        cut_face=cut_face,
        distance_mm=1200.0,
        field_mm=400.0,
    )


CASES: dict[str, Case] = {
    "plain": Case(make_scene),
    "50 % outliers": Case(lambda rng, rays: make_scene(rng, rays, outliers=0.5)),
    "face cut to 10 %": Case(lambda rng, rays: make_scene(rng, rays, cut_face=0.1)),
    "face at 72 deg": Case(_at(72.0)),
    "face at 75 deg": Case(_at(75.0)),
    "face at 78 deg": Case(_at(78.0)),
    "noise x3 untold": Case(lambda rng, rays: make_scene(rng, rays, sigma_mm=0.06)),
    "room": Case(lambda rng, rays: make_scene(rng, rays, extras=room(rng))),
    "box of 40": Case(lambda rng, rays: make_scene(rng, rays, field_mm=220, extras=box_beside(rng, 40))),
    "box of 60": Case(lambda rng, rays: make_scene(rng, rays, field_mm=220, extras=box_beside(rng, 60))),
    "box of 100": Case(lambda rng, rays: make_scene(rng, rays, field_mm=220, extras=box_beside(rng, 100))),
    "fillet 1 mm": Case(lambda rng, rays: make_scene(rng, rays, fillet_mm=1.0)),
    "concave": Case(lambda rng, rays: make_scene(rng, rays, convex=False), Jig(convex=False)),
    "concave, fillet": Case(lambda rng, rays: make_scene(rng, rays, convex=False, fillet_mm=1.0), Jig(convex=False)),
    "cylinder": Case(lambda rng, rays: make_scene(rng, rays, field_mm=200, extras=(cylinder_beside(rng),))),
    "parallel planes": Case(parallel_planes),
    "4k points": Case(lambda rng, rays: make_scene(rng, 4_300)),
    "8k points": Case(lambda rng, rays: make_scene(rng, 8_600)),
    "jig small in view": Case(lambda rng, rays: make_scene(rng, rays, field_mm=400)),
    "edge 30 mm": Case(_sized(30.0, 400.0), Jig(edge_mm=30.0)),
    "edge 120 mm": Case(_sized(120.0, 1400.0), Jig(edge_mm=120.0)),
    "three edges": Case(_unlike(rectangular=False), _THREE_EDGES),
    "box 70 x 110 x 160": Case(_unlike(rectangular=True), _THREE_EDGES),
    "box, face cut": Case(_unlike(rectangular=True, cut_face=0.3), _THREE_EDGES),
    "noise 0.01 untold": Case(lambda rng, rays: make_scene(rng, rays, sigma_mm=0.01), told_sigma_mm=None),
    "noise 0.3 untold": Case(lambda rng, rays: make_scene(rng, rays, sigma_mm=0.3), told_sigma_mm=None),
    "nothing behind": Case(lambda rng, rays: make_scene(rng, rays, background=False)),
    "strays 1:1": Case(_with_strays(spread, 1.0)),
    "strays 2:1": Case(_with_strays(spread, 2.0)),
    "clumps 1:1": Case(_with_strays(clumps, 1.0)),
    "concave, shiny": Case(
        lambda rng, rays: reflections(make_scene(rng, rays, convex=False), rng, 0.05), Jig(convex=False)
    ),
    "mixed pixels 100 %": Case(lambda rng, rays: make_scene(rng, rays, flying=1.0)),
    "waves 0.02/15 mm": Case(lambda rng, rays: make_scene(rng, rays, waves_mm=0.02)),
    "waves 0.02/5 mm": Case(lambda rng, rays: make_scene(rng, rays, waves_mm=0.02, wave_length_mm=5.0)),
}
