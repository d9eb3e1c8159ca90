"""What arms of a type have in common: mean and scatter of their parameters, as the prior of another arm's fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class TypePrior:
    """Prior of an arm's parameters by full name, mm, rad or an effect's own units."""

    means: Mapping[str, float] = field(default_factory=dict)
    sigmas: Mapping[str, float] = field(default_factory=dict)
