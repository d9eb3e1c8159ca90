"""The catalogue: the effects in their order, and look-ups by name. What is known of an effect stands on its class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calib.dataset.dataset import Dataset
from calib.effects.catalogue.compliance import (
    BaseCompliance,
    GravityBacklash,
    JointCompliance,
    LinkBending,
    ToolSag,
)
from calib.effects.catalogue.joint_shapes import (
    AsymmetricScale,
    CableDrag,
    FollowingError,
    HighHarmonic,
    JointDent,
)
from calib.effects.catalogue.joints import (
    AxisWobble,
    Backlash,
    JointCoupling,
    JointScale,
    StrainWave,
    TransmissionError,
)
from calib.effects.catalogue.loads import BearingClearance, LinkTorsion, NonlinearStiffness
from calib.effects.catalogue.order_steps import BaseLoosening, JointStep, ScannerStep, TargetStep
from calib.effects.catalogue.scanner import IncidenceBias, ScannerDistortion, ScannerDrift, ScannerScale
from calib.effects.catalogue.thermal import ThermalGrowth, WarmUp
from calib.effects.effect import CatalogueEffect, Description, Effect, Family, describe, full_name
from calib.errors import CalibError

CATALOGUE: tuple[type[CatalogueEffect], ...] = (
    JointCompliance,
    LinkBending,
    TransmissionError,
    StrainWave,
    JointScale,
    JointCoupling,
    Backlash,
    GravityBacklash,
    ThermalGrowth,
    BaseCompliance,
    AxisWobble,
    ScannerDistortion,
    ScannerDrift,
    ToolSag,
    IncidenceBias,
    ScannerScale,
    JointStep,
    JointDent,
    TargetStep,
    ScannerStep,
    BaseLoosening,
    WarmUp,
    FollowingError,
    AsymmetricScale,
    HighHarmonic,
    CableDrag,
    NonlinearStiffness,
    LinkTorsion,
    BearingClearance,
)


def catalogue_names() -> tuple[str, ...]:
    """Names of the effects that a model can have, in the order of the catalogue.

    >>> import calib
    >>> calib.catalogue_names()[:2]
    ('joint_compliance', 'link_bending')
    """
    return tuple(kind.name for kind in CATALOGUE)


def descriptions() -> tuple[Description, ...]:
    """What each family is, without any dataset."""
    return tuple(describe(kind) for kind in CATALOGUE)


def effects_for(dataset: Dataset) -> tuple[Family, ...]:
    """Every family of the catalogue, made for this robot and these conditions; those without data say why.

    Whether poses are rich enough to tell a family from geometry is found by `calib.screening.candidates`, not here.
    """
    points = dataset.points
    if points is not None and dataset.poses.is_test[points.pose].all():
        dataset = replace(dataset, points=None)  # of test poses no family may take its places and ranges
    return tuple(kind.family(dataset) for kind in CATALOGUE)


def family_of(dataset: Dataset, name: str, more: Sequence[Family] = ()) -> Family:
    """A family by its name, of the catalogue or of the user's own. Raises CalibError on an unknown name."""
    families = (*effects_for(dataset), *more)
    for family in families:
        if family.name == name:
            return family
    raise CalibError(f"no effect named {name!r}; there are {', '.join(f.name for f in families)}")


def available_family(dataset: Dataset, name: str, more: Sequence[Family] = ()) -> Family:
    """The family of a name (`family_of`) that this dataset can test; else CalibError says what would help."""
    family = family_of(dataset, name, more)
    _require_testable(family)
    return family


def _require_testable(family: Family) -> None:
    """Raise CalibError for a family that a dataset cannot test."""
    if family.why_not:
        raise CalibError(f"effect {family.name} cannot be fitted here: {family.why_not}; {family.would_help}")


EffectChoice = str | type[CatalogueEffect] | Family | Effect
"""An effect as a caller may give it: its family's name or class or the family, for all members, or a single member."""


def effects_named(
    dataset: Dataset, effects: EffectChoice | Sequence[EffectChoice], user_effects: Sequence[Family] = ()
) -> tuple[Effect, ...]:
    """The members of the effects that were chosen, for `calibrate`: all of a family's where that is given.

    Raises CalibError for unknown and for untestable ones, and for families of which a fit has to choose members.
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
    """The family that is meant, None for a single member. Raises CalibError where it cannot be tested."""
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
