"""Corrected joint vectors of targets, and what gives them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array, BoolArray
from calib.dataset.dataset import Poses
from calib.kinematics.robot import Robot
from calib.lazy_modules import pd
from calib.presented import Presented


@dataclass(frozen=True)
class Correction(Presented):
    """Corrected joint vectors of N targets, with errors of the calibrated arm against the nominal tool frames."""

    robot: Robot  # nominal
    kind: str  # "position" or "pose"
    q_nominal: Array  # (N, n) rad, mm for prismatic joints
    q: Array  # (N, n) corrected; where `reached` is false, the nearest that limits allow
    reached: BoolArray  # (N,) to 1e-9 mm; attitudes that count to 1e-12 rad, near singular ones to their sigma
    position_error_mm: Array  # (N,) with q
    orientation_error_rad: Array  # (N,) with q; nan where only the position counts
    uncorrected_mm: Array  # (N,) position error with q_nominal
    reasons: tuple[str, ...]  # (N,) why a target is not reached, as text; "" where it is
    uncorrected_rad: Array  # (N,) turn of the tool with q_nominal, by the calibrated arm
    changed: tuple[str, ...] = ()  # effects that changed the arm during the measurements; the last state counts
    attitude_sigma_rad: Array | None = None  # (N,) sigma of the tool's attitude; None where the fit is unknown
    is_outside: BoolArray | None = None  # (N,) a joint is beyond the trained ranges; None where these are unknown
    outside_words: str = ""
    sigma_mm: Array | None = None  # (N,) promised for a measured coordinate at q; None where the fit is unknown

    @property
    def change(self) -> Array:
        """Change (N, n) of the joints by the correction: rad, mm for prismatic joints."""
        return self.q - self.q_nominal

    @property
    def largest_move_deg(self) -> float:
        """Largest move of a revolute joint over the targets that are reached, deg; 0 where none is."""
        moved = np.abs(self.change[self.reached][:, self.robot.is_revolute])
        return float(np.degrees(moved.max(initial=0.0)))

    def to_frame(self) -> pd.DataFrame:
        """Table with one row per target: reached, errors before and after, and the reason if missed."""
        return pd.DataFrame(
            {
                "reached": self.reached,
                "uncorrected_mm": self.uncorrected_mm,
                "position_error_mm": self.position_error_mm,
                "orientation_error_rad": self.orientation_error_rad,
                "reason": self.reasons,
                "uncorrected_rad": self.uncorrected_rad,
                "attitude_sigma_rad": np.full(len(self.q), np.nan)
                if self.attitude_sigma_rad is None
                else self.attitude_sigma_rad,
                "sigma_mm": np.full(len(self.q), np.nan) if self.sigma_mm is None else self.sigma_mm,
            }
        )

    def _brief(self) -> str:
        return f"{self.robot.name}: {int(self.reached.sum())} of {len(self.q)} targets reached ({self.kind})"


@runtime_checkable
class Corrects(Protocol):
    """Protocol of a fitted result that corrects joint vectors: a calibration, a diagnosis, a model from a file."""

    def correct(
        self,
        q_nominal: ArrayLike,
        conditions: Poses | None = None,
        kind: str | None = None,
        nominal: Robot | None = None,
        ids: Sequence[str] | None = None,
    ) -> Correction:
        """Joint vectors with which the calibrated arm goes where the nominal one would."""
        ...
