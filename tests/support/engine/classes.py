"""The classes of cases: what is asked of a diagnosis, from the plain to the unforeseen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations

import numpy as np

from tests.support.engine.cases import CATALOGUE, NEW, UNFORESEEN, Case
from tests.support.engine.noise import KINDS

ODD = KINDS[1:]
NAMES = tuple(CATALOGUE)
PAIRS = tuple(combinations(NAMES, 2))
SHAPES: tuple[dict[str, int], ...] = (
    {"poses": 20},
    {"poses": 30},
    {"poses": 300},
    {"setups": 2},
    {"targets": 2},
    {"repeats": 3},
    {"poses": 150},
    {"setups": 3, "targets": 2},
)
"""Number of poses, of the scanner's placements, of further targets, of repeats of a pose."""

_GRAVITY = ("joint_compliance", "link_bending", "base_compliance")


def _singles(count: int, seed: int) -> Iterator[Case]:
    for k in range(count):
        yield Case("single", (NAMES[(k + seed) % len(NAMES)],), k, seed)


def _shapes(count: int, seed: int) -> Iterator[Case]:
    for k in range(count):
        name = NAMES[(4 * k + seed) % len(NAMES)]
        shape = SHAPES[k % len(SHAPES)]
        if name == "incidence_bias":  # of a jig's faces, which balls beside it do not have
            shape = shape | {"targets": 0}
        yield Case("shapes", (name,), k, seed, **shape)


def _pairs(count: int, seed: int) -> Iterator[Case]:
    order = np.random.default_rng(seed).permutation(len(PAIRS))
    for k in range(count):
        yield Case("pair", PAIRS[order[k % len(order)]], k, seed)


def _nulls(count: int, seed: int) -> Iterator[Case]:
    for k in range(count):
        shape = SHAPES[(k // 2) % len(SHAPES)] if k % 2 else {}
        yield Case("null", (), k, seed, **shape)


def _odd_nulls(count: int, seed: int) -> Iterator[Case]:
    for k in range(count):
        yield Case("odd null", (), k, seed, noise=ODD[k % len(ODD)])


def _odd_singles(count: int, seed: int) -> Iterator[Case]:
    for k in range(count):
        yield Case("odd single", (NAMES[(2 * k + seed) % len(NAMES)],), k, seed, noise=ODD[k % len(ODD)])


def _new(count: int, seed: int) -> Iterator[Case]:
    for k in range(count):
        yield Case("new", (tuple(NEW)[k % len(NEW)],), k, seed)


def _unforeseen(count: int, seed: int) -> Iterator[Case]:
    for k in range(count):
        yield Case("unforeseen", (tuple(UNFORESEEN)[k % len(UNFORESEEN)],), k, seed)


def _no_masses(count: int, seed: int) -> Iterator[Case]:
    for k in range(count):
        yield Case("no masses", (_GRAVITY[k % 3],), k, seed, masses="unknown", undecidable=True)


def _wrong_masses(count: int, seed: int) -> Iterator[Case]:
    for k in range(count):
        yield Case("wrong masses", (_GRAVITY[k % 2],), k, seed, masses="wrong", sigmas=(20.0,))


def _twins(count: int, seed: int) -> Iterator[Case]:
    for k in range(count):
        name = ("axis_wobble", "transmission_error")[k % 2]
        yield Case("twin", (name,), k, seed, twin=True, undecidable=True)


CLASSES: dict[str, tuple[Callable[[int, int], Iterator[Case]], int]] = {
    "single": (_singles, 30),
    "shapes": (_shapes, 8),
    "pair": (_pairs, 8),
    "null": (_nulls, 12),
    "odd null": (_odd_nulls, 12),
    "odd single": (_odd_singles, 8),
    "new": (_new, 26),
    "unforeseen": (_unforeseen, 14),
    "no masses": (_no_masses, 6),
    "wrong masses": (_wrong_masses, 4),
    "twin": (_twins, 4),
}
"""How many of each make the standard run."""


def cases(per_class: int | None = None, seed: int = 0, only: tuple[str, ...] = ()) -> list[Case]:
    """All cases of a run, or those of some classes."""
    return [
        case
        for name, (make, count) in CLASSES.items()
        if not only or name in only
        for case in make(count if per_class is None else per_class, seed)
    ]
