"""Kind of a plug-in's nominal tables, with which a dataset's robot is compared where its table may be another arm's."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class KnownTables:
    """Robots whose nominal tables a plug-in knows."""

    robots: str  # "module:name" of () -> a list of (name, Robot)
