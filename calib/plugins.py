"""Plug-ins: what each folder of `calib.extras`, and anybody's own package, brings, found without being named anywhere.

A plug-in is a module with a tuple `CONTRIBUTIONS`. Each contribution is a frozen value of a kind, which is declared
by the room that asks for it (`PublicNames` here, `Command` in `inspector.plugins`). It says what is brought, and
where it is as "module:name", which `load` imports when it is first used: all plug-ins are read at every start, so
they import nothing slow.

There are two ways to be found: a folder of a package that is walked (`calib.extras`, `inspector.extras`), with a
module `plugin`; and the entry point group `calib.plugins` of an installed distribution, whose value is such a module.
One that cannot be imported is left out and told by `left_out`; everything else works without it.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, TypeVar

EXTRAS = "calib.extras"
GROUP = "calib.plugins"  # of entry points; each names a module that has CONTRIBUTIONS
_MODULE = "plugin"
_ATTRIBUTE = "CONTRIBUTIONS"

Kind = TypeVar("Kind")


@dataclass(frozen=True)
class PublicNames:
    """Names that `import calib` offers of a plug-in's module, as `calib.watch`."""

    module: str
    names: tuple[str, ...]


@dataclass(frozen=True)
class Presentations:
    """Modules that register what they make of results, as those of `calib.present` do; see `calib.present.results`."""

    modules: tuple[str, ...]


@dataclass(frozen=True)
class CalibrationPart:
    """What a plug-in tells of a fit of points, each a function of the Calibration as "module:name"."""

    title: str  # of the section that has its figures
    facts: str  # list of names and values, behind those on where the instrument is
    figures: str  # list of FigurePlaces
    document: str  # further keys of the document that `calibrate --json` prints


@dataclass(frozen=True)
class _Plugins:
    contributions: tuple[object, ...]  # in the order of the plug-ins' names
    left_out: tuple[str, ...]  # a line each


def contributions(kind: type[Kind], package: str = EXTRAS) -> tuple[Kind, ...]:
    """All contributions of one kind, those of the package's folders first, then those of installed distributions.

    Args:
        kind: class of the contributions.
        package: the package whose folders are walked; a package that is not there has none.
    """
    found = (*_walked(package).contributions, *_installed().contributions)
    return tuple(each for each in found if isinstance(each, kind))


def left_out(package: str = EXTRAS) -> tuple[str, ...]:
    """A line for each plug-in that could not be imported, with the reason; all else works without it."""
    return (*_walked(package).left_out, *_installed().left_out)


def load(place: str) -> Any:
    """Import what "module:name" says; a place without a name is the module itself."""
    module, _, name = place.partition(":")
    loaded = import_module(module)
    return getattr(loaded, name) if name else loaded


@cache
def _walked(package: str) -> _Plugins:
    """Plug-ins in the folders of a package; none where the package itself is not there.

    It is sought where the package above it was found: another checkout, installed beside this one, has no say.
    """
    above, _, name = package.rpartition(".")
    places = import_module(above).__path__ if above else sys.path
    names = sorted(found.name for found in iter_modules([str(Path(place, name)) for place in places]) if found.ispkg)
    return _imported([(found, f"{package}.{found}.{_MODULE}") for found in names])


@cache
def _installed() -> _Plugins:
    """Plug-ins of installed distributions, by their entry points."""
    from importlib.metadata import entry_points  # its own imports take a while

    found = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    return _imported([(entry.name, entry.value) for entry in found])


def _imported(places: list[tuple[str, str]]) -> _Plugins:
    """The contributions of modules by their plug-ins' names; whatever a module raises leaves that one out alone."""
    brought: list[object] = []
    refused: list[str] = []
    for name, module in places:
        try:
            brought += getattr(import_module(module), _ATTRIBUTE)
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            refused.append(f"plug-in {name} ({module}) cannot be imported and is left out: {reason}")
    return _Plugins(tuple(brought), tuple(refused))
