"""The catalogue: the effects in their order, and look-ups by name.

A module of this package holds the effects of one part of the cell; the words before the colon of its docstring are
their heading in the documentation. Every subclass of `CatalogueEffect` with a `name` in one
of them is in the catalogue.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module

from calib.dataset.dataset import Dataset
from calib.effects.effect import (
    CatalogueEffect,
    Description,
    Effect,
    Family,
    describe,
    registered_effects,
    registered_member_kinds,
)
from calib.errors import CalibError


def catalogue_names() -> tuple[str, ...]:
    """Names of the catalogue's families, in its order."""
    return tuple(kind.name for kind in CATALOGUE)


def descriptions() -> tuple[Description, ...]:
    """Texts on each family, in the catalogue's order; they need no dataset."""
    return tuple(describe(kind) for kind in CATALOGUE)


def effects_for(dataset: Dataset) -> tuple[Family, ...]:
    """Every family of the catalogue, with members for a dataset's robot and conditions; those without data say why.

    Whether poses are rich enough to tell a family from geometry is found by `calib.screening.candidates`, not here.
    """
    points = dataset.points
    if points is not None and dataset.poses.is_test[points.pose].all():
        dataset = replace(dataset, points=None)  # families take no places and ranges from test poses
    return tuple(kind.family(dataset) for kind in CATALOGUE)


def family_of(dataset: Dataset, name: str, more: Sequence[Family] = ()) -> Family:
    """Family of a name, from the catalogue or of the user's own. Raises CalibError on an unknown name."""
    families = (*effects_for(dataset), *more)
    for family in families:
        if family.name == name:
            return family
    raise CalibError(f"no effect named {name!r}; there are {', '.join(f.name for f in families)}")


def available_family(dataset: Dataset, name: str, more: Sequence[Family] = ()) -> Family:
    """Family of a name that this dataset can test. Raises CalibError that says what would help where it cannot."""
    family = family_of(dataset, name, more)
    if family.why_not:
        raise CalibError(f"effect {name} cannot be fitted here: {family.why_not}; {family.would_help}")
    return family


def effects_named(dataset: Dataset, names: Sequence[str], user_effects: Sequence[Family] = ()) -> tuple[Effect, ...]:
    """All members of families by name, for `calibrate`.

    Raises CalibError for unknown and untestable families, and for sparse ones, of which a fit has to choose members.
    """
    families = [available_family(dataset, name, user_effects) for name in dict.fromkeys(names)]
    for family in families:
        if family.sparse:
            raise CalibError(
                f"effect {family.name} could be at {len(family.members)} places and is at few of them: add it with "
                f"--add {family.name}, which finds them, not as a whole"
            )
    return tuple(member for family in families for member in family.members)


for _module in pkgutil.iter_modules(__path__):  # by name; after what they import from here
    import_module(f"{__name__}.{_module.name}")

CATALOGUE: tuple[type[CatalogueEffect], ...] = registered_effects()
"""The effects' classes, by `position`."""
MEMBER_KINDS: tuple[type[CatalogueEffect], ...] = registered_member_kinds()
"""The classes of all their members: several of a family where its unknowns depend on the data, such as masses."""
