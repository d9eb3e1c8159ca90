"""How many points a scan's file holds, and how many of its rows have no value."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PointCount:
    """One scan's points."""

    points: int  # with a value
    dropped: int  # rows without one, left out on loading

    @property
    def share_dropped(self) -> float:
        """0 to 1, of all rows."""
        return self.dropped / max(self.points + self.dropped, 1)
