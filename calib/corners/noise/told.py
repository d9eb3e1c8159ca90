"""What is known of a scanner's smooth error beforehand."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ToldNoise:
    """What `[scanner]` of dataset.toml tells; 0: nothing."""

    correlated_sigma_mm: float = 0.0  # of the error that neighbouring points share, along the ray
    correlation_length_mm: float = 0.0  # l of its correlation exp(-r^2 / 2 l^2)


NOTHING_TOLD = ToldNoise()
