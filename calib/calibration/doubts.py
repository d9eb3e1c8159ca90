"""Kind of a plug-in that may know of a fit that something else than the links errs, which these have taken up."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LinkDoubt:
    """What was taken up by the links of a fit, so that no entry of the robot's table is to be doubted."""

    sentences: str  # "module:name", Calibration -> list of sentences without capital, [] where the links are to be had
