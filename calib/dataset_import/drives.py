"""What drives do by their own readings: joints as commanded against joints as read, without any measured point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.dataset_import.column_words import WORDS, words_of
from calib.rendering import numbers
from calib.text_files.column_names import ANGLES_RAD, split_unit
from calib.text_files.user_table import UserTable

_FEWEST = 4
_TWICE = 2.0  # times what the best law leaves, up to which another fits as well
_LEAST_DEG = 0.02  # of a difference worth a word


@dataclass(frozen=True)
class DriveLaw:
    """A law of what a joint reads less what it was commanded, with its one fitted number."""

    name: str  # "a spring against gravity, 39.2 deg x sin(angle)"
    left_deg: float  # root mean square
    error_deg: Array  # (361,) of the law at -180 to 180 deg that are read


def drives_in_words(table: UserTable) -> list[str]:
    """A line for each joint that a table has as commanded and as read: which laws fit, and what tells them apart."""
    return [line for joint, commanded, read in _pairs(table) if (line := _told(joint, commanded, read))]


def _pairs(table: UserTable) -> Iterator[tuple[str, Array, Array]]:
    """Name, commanded and read angles (N,), deg, of each joint."""
    named: dict[tuple[str, ...], dict[str, str]] = {}
    for name in table.columns:
        words = words_of(split_unit(name)[0])
        for kind, known in (("commanded", WORDS["commanded"] | {"target", "set", "soll"}), ("read", WORDS["read"])):
            if words & known:
                named.setdefault(tuple(sorted(words - known)), {})[kind] = name
    for found in named.values():
        if len(found) == 2:
            names = (found["commanded"], found["read"])
            values = table.known(names)
            scale = np.degrees(ANGLES_RAD.get(split_unit(names[1])[1], ANGLES_RAD["deg"]))
            commanded, read = scale * values[np.isfinite(values).all(axis=1)].T
            yield names[1], commanded, read


def _told(joint: str, commanded: Array, read: Array) -> str:
    off = read - commanded
    if len(off) < _FEWEST or np.abs(off).max() < _LEAST_DEG:
        return ""
    laws = sorted(_laws(commanded, read), key=lambda law: law.left_deg)
    near = [law for law in laws if law.left_deg <= _TWICE * laws[0].left_deg + _LEAST_DEG]
    fits = numbers.listing([f"{law.name} leaves {law.left_deg:.2g} deg" for law in near])
    text = f"{joint} is {np.abs(off).min():.3g} to {np.abs(off).max():.3g} deg from what was commanded: {fits} rms"
    if len(near) < len(laws):
        text += f", the next, {laws[len(near)].name}, {laws[len(near)].left_deg:.2g}"
    if len(near) < 2:
        return text
    apart = np.abs(near[0].error_deg - near[1].error_deg)
    angle = int(np.argmax(apart)) - 180
    return (
        f"{text}: {len(off)} poses do not tell them apart; one that reads {angle:d} deg would, where they differ by "
        f"{apart.max():.3g} deg"
    )


def _laws(commanded: Array, read: Array) -> Iterator[DriveLaw]:
    """Laws of one number each, fitted by least squares."""
    off, at = read - commanded, np.arange(-180.0, 181.0)

    def law(words: str, shape: Array, error: Array, target: Array = off) -> DriveLaw:
        size = float(shape @ target) / max(float(shape @ shape), 1e-12)
        left_deg = float(np.sqrt(np.sum((target - size * shape) ** 2) / max(len(off) - 1, 1)))
        return DriveLaw(words.format(size, -size, 2.0 * abs(size)), left_deg, size * error)

    scale = law("a scale of {0:.3g}", commanded, np.ones(361), read)
    yield replace(scale, error_deg=at * (1.0 - 1.0 / scale.error_deg[0]))
    yield law("a zero that is off by {0:.3g} deg", np.ones(len(off)), np.ones(361))
    for name, function in (("sin", np.sin), ("cos", np.cos)):
        words = f"a spring against gravity, {{1:.3g}} deg x {name}(angle),"
        yield law(words, function(np.radians(read)), function(np.radians(at)))
    way = np.sign(np.diff(commanded, prepend=2.0 * commanded[0] - commanded[1]))
    if len(set(way.tolist())) > 1:
        yield law("a dead band of {2:.3g} deg", way, np.ones(361))
