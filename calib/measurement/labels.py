"""The result of labelling the jig's faces: at each pose the jig's orientation, and what told the faces apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from calib.corners.orientation import Orientation

LEAST_MARGIN_DEG = 60.0
"""How much nearer the best of three labellings has to be than the next; they lie 120 degrees apart."""
LEAST_MISFIT_MARGIN = 12.0
"""How much less, in squared sigmas, the angles' misfit of one labelling has to be than that of the others."""
_LABELLED_BY = {
    "robot": "the nominal robot",
    "angles": "the jig's unequal angles",
    "continuity": "small turns from pose to pose",
}


@dataclass(frozen=True)
class FaceLabels:
    """The jig's orientation at each pose, its faces labelled alike at all of them."""

    by: str  # "robot", "angles" or "continuity"
    orientations: Mapping[str, Orientation]  # by pose id
    off: Mapping[str, float]  # by pose id: difference of the best labelling from what was expected; see `unit`
    margin: Mapping[str, float]  # by pose id: how much larger the next-best labelling's difference is
    unit: str  # of both: "deg", or "squared sigmas" where the jig's angles decide
    refused: Mapping[str, str]  # pose id -> why its faces cannot be labelled
    found_angles_deg: tuple[float, float, float] | None = None  # used instead of the jig's, where those do not fit
    lack: str = ""  # of the first refused pose: why it has no labels, and what would help

    def summary(self) -> str:
        """One line: what the labels follow from, the least margin, and how many poses were refused."""
        unit, needed = f" {self.unit}", f"{LEAST_MISFIT_MARGIN:g}"
        if self.unit == "deg":
            unit, needed = "°", f"{LEAST_MARGIN_DEG:g}°"
        least = f", margin {min(self.margin.values()):.4g}{unit} or more (needed: {needed})" if self.margin else ""
        first = next(iter(self.refused.items()), None)
        refused = f"; {len(self.refused)} refused, {first[0]}: {first[1]}" if first else ""
        meet = ", ".join(f"{angle:.4f}°" for angle in self.found_angles_deg or ())
        angles = f"; they meet at {meet}, which differs from what dataset.toml tells" if meet else ""
        count = len(self.orientations)
        poses = f"{count} pose{'' if count == 1 else 's'}"
        return f"faces named by {_LABELLED_BY[self.by]} at {poses}{least}{angles}{refused}"
