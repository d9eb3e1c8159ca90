"""A family: an effect with its members for one robot and dataset, and what its class says of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from calib.dataset.dataset import Dataset
from calib.effects.effect import Effect, family_name


@dataclass(frozen=True)
class Family:
    """An effect as it is named: one cause, with a member for each joint (and harmonic) that may carry it or not."""

    name: str
    members: tuple[Effect, ...]
    why_not: str = ""  # why this dataset cannot speak about it, "" where it can
    would_help: str = ""  # the data that would change that
    note: str = ""  # what was assumed, such as unknown masses

    @property
    def description(self) -> Description:
        """What the members' class says; of a family without members the name alone."""
        return describe(self.members[0]) if self.members else Description(self.name)


class CatalogueEffect(ABC):
    """What the class of an effect of the catalogue says, besides `parameters` and `apply`: all that is told about it.

    An effect of a user's own needs none of this; it may carry `equation`, `symbols`, `needs` and `confirm` too.
    """

    name: ClassVar[str]  # as the command line and the files take it
    equation: ClassVar[str]
    symbols: ClassVar[tuple[tuple[str, str], ...]]  # the equation's unknowns: name, unit
    needs: ClassVar[str]  # what a dataset must hold
    confirm: ClassVar[str] = ""  # a controlled change that shows this cause and leaves the others as they are

    @classmethod
    @abstractmethod
    def family(cls, dataset: Dataset) -> Family:
        """The members that this robot may have under these conditions; without the data for it, why not."""


@dataclass(frozen=True)
class Description:
    """What an effect's class says of it, "" where it says nothing."""

    name: str
    equation: str = ""
    symbols: tuple[tuple[str, str], ...] = ()  # name, unit
    needs: str = ""
    confirm: str = ""


def describe(effect: Effect | type[CatalogueEffect]) -> Description:
    """The texts on an effect's class."""
    name = effect.name if isinstance(effect, type) else family_name(effect)
    texts = ("equation", "symbols", "needs", "confirm")
    return Description(name, **{text: getattr(effect, text) for text in texts if hasattr(effect, text)})


def families_from(effects: Sequence[Effect]) -> tuple[Family, ...]:
    """Effects of a user's own, those of one name together."""
    names = list(dict.fromkeys(family_name(effect) for effect in effects))
    return tuple(Family(name, tuple(e for e in effects if family_name(e) == name)) for name in names)
