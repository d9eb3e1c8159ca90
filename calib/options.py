"""What a user may choose. Nothing that takes time is imported here, so that `inspector --help` answers at once."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from calib.noise_shape import NoiseShape

RESIDUAL_KINDS = ("position", "distance", "pairs", "pose")
"""What a fit may make small: `calib.fitting.residual_kinds`."""
CORRECTION_KINDS = ("position", "pose")
"""What a correction may bring right: `calib.compensation.target_correction`."""
PLAN_REGIONS = ("auto", "test", "measurable", "all")
"""Where a planned fit may be wanted right: `calib.planning.plan`."""
PLAN_CRITERIA = ("I", "D")
"""What a plan for a calibration may make small: `calib.planning.purpose`."""
DEFAULT_FOLDS = 5  # of a cross-validation
BUILTIN_ROBOTS = ("rb5", "panda")
"""Robots that come with the library: `calib.dataset.files.robot_toml`."""


@dataclass(frozen=True)
class FitOptions:
    """What the user asks of a fit. The result keeps it, and every fit that follows from it is made in the same way."""

    residual: str = "position"
    """"position" (free scanner frames), "distance" (Jang), "pairs", or "pose" (with the orientations)."""
    prior: bool = True
    """Hold parameters within about their tolerance."""
    held: tuple[str, ...] = ()
    """Names of parameters that stay at their nominal value."""
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """Tolerances of single link parameters, by name, in mm or rad, where the default of 1 mm and 0.5 deg is wrong."""
    robust: bool = False
    """Leave poses out that stand out of all others (`calib.fitting.robust`); not for "distance"."""
    noise: NoiseShape | None = None
    """The shape of the measured points' noise, where it is known to differ from the declared one."""

    def with_residual(self, residual: str) -> FitOptions:
        """The same for another kind of residual."""
        return replace(self, residual=residual)

    def for_parameters(self, names: Collection[str]) -> FitOptions:
        """The same for a model that has these parameters only: others cannot be held in it."""
        return replace(self, held=tuple(name for name in self.held if name in names))
