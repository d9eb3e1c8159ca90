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
    full_name,
    registered_effects,
    registered_member_kinds,
)
from calib.errors import CalibError


def catalogue_names() -> tuple[str, ...]:
    """Names of the effects that a model can have, in the order of the catalogue.

    >>> import calib
    >>> calib.catalogue_names()[:2]
    ('joint_compliance', 'link_bending')
    """
    return tuple(kind.name for kind in CATALOGUE)


def descriptions() -> tuple[Description, ...]:
    """Description of each effect of the catalogue, in the catalogue's order; no dataset is needed."""
    return tuple(describe(kind) for kind in CATALOGUE)


def effects_for(dataset: Dataset) -> tuple[Family, ...]:
    """Every effect of the catalogue as a family of members for a dataset's robot, with the reason if it is untestable.

    Whether poses are rich enough to tell a family from geometry is found by `calib.screening.candidates`, not here.
    """
    points = dataset.points
    if points is not None and dataset.poses.is_test[points.pose].all():
        dataset = replace(dataset, points=None)  # families take no places and ranges from test poses
    families = tuple((kind, kind.family(dataset)) for kind in CATALOGUE)
    if dataset.robot.is_cartesian:
        return tuple(family if kind.of != "arm" else _of_unknown_arm(family) for kind, family in families)
    return tuple(family for _, family in families)


def _of_unknown_arm(family: Family) -> Family:
    """The family as one that poses of the flange cannot test."""
    why_not = "the dataset has poses of the flange and no joint values"
    return replace(family, members=(), why_not=why_not, would_help="log the joints beside the poses")


def family_of(dataset: Dataset, name: str, more: Sequence[Family] = ()) -> Family:
    """Effect family with a given name, of the catalogue or of the user's own. Raises CalibError on an unknown name."""
    families = (*effects_for(dataset), *more)
    for family in families:
        if family.name == name:
            return family
    raise CalibError(f"no effect named {name!r}; there are {', '.join(f.name for f in families)}")


def available_family(dataset: Dataset, name: str, more: Sequence[Family] = ()) -> Family:
    """Effect family with a given name. Raises CalibError, with what would help, if the dataset cannot test it."""
    family = family_of(dataset, name, more)
    _require_testable(family)
    return family


def _require_testable(family: Family) -> None:
    """Raise CalibError for an effect family that a dataset cannot test."""
    if family.why_not:
        raise CalibError(f"effect {family.name} cannot be fitted here: {family.why_not}; {family.would_help}")


EffectChoice = str | type[CatalogueEffect] | Family | Effect
"""An effect as a caller may give it: its family's name or class or the family, for all members, or a single member."""


def effects_named(
    dataset: Dataset, effects: EffectChoice | Sequence[EffectChoice], user_effects: Sequence[Family] = ()
) -> tuple[Effect, ...]:
    """Effects to fit for a user's choice: a single member of a family (one joint, say), or all members of a family.

    Raises CalibError for unknown and untestable families, and for sparse ones, of which a fit has to choose members.
    """
    chosen = effects if isinstance(effects, Sequence) and not isinstance(effects, str) else (effects,)
    members: dict[tuple[str, ...], Effect] = {}  # by parameters, so that what is named twice is there once
    for choice in chosen:
        family = _family(dataset, choice, user_effects)
        if family is not None and family.sparse:
            raise CalibError(
                f"effect {family.name} could be at {len(family.members)} places and is at few of them: add it with "
                f"--add {family.name}, which finds them, not as a whole"
            )
        for member in (choice,) if family is None else family.members:
            assert isinstance(member, Effect)
            members[tuple(full_name(member, parameter) for parameter in member.parameters)] = member
    return tuple(members.values())


def _family(dataset: Dataset, choice: EffectChoice, user_effects: Sequence[Family]) -> Family | None:
    """Effect family that a user chose; None for a single member. Raises CalibError where it cannot be tested."""
    if isinstance(choice, type):
        choice = choice.name
    if isinstance(choice, str):
        return available_family(dataset, choice, user_effects)
    if isinstance(choice, Family):
        _require_testable(choice)
        return choice
    if not isinstance(choice, Effect):
        raise CalibError(
            f"found a {type(choice).__name__} as an effect; expected a name, such as {CATALOGUE[0].name!r}, a family, "
            "or an effect with `parameters` and `apply`"
        )
    return None


for _module in pkgutil.iter_modules(__path__):  # by name; after what they import from here
    import_module(f"{__name__}.{_module.name}")

CATALOGUE: tuple[type[CatalogueEffect], ...] = registered_effects()
"""The effects' classes, by `position`."""
MEMBER_KINDS: tuple[type[CatalogueEffect], ...] = registered_member_kinds()
"""The classes of all their members: several of a family where its unknowns depend on the data, such as masses."""
