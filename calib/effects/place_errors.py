"""Errors of the known places that an arm visits, such as the sockets of a plate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.dataset.dataset import Dataset
from calib.effects.effect import Parameter
from calib.effects.state import RobotState
from calib.errors import DatasetError
from calib.kinematics.robot import Robot

_MOST = 100  # places; more are no plate, but points that differ by noise
_FEWEST_VISITS = 3  # on average, below which points are no visits of known places


@dataclass(frozen=True)
class PlaceErrors(Brief):
    """Where K known places truly are, from where the dataset has them: along x, y, z of the plate's frame, mm.

    The dataset's points are the declared places, and each is off by the same vector at every visit, wherever the plate
    stands. That moves the reported point: declared = true - error.
    """

    places_mm: tuple[tuple[float, float, float], ...]
    sigma_mm: float  # declared, along each axis
    name = "place_errors"
    linear = True
    corrects_robot = True  # in every fit; it changes no entry of robot.toml

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Errors of each place's coordinates, the declared ones their nominal values: places.1x places.1y ..."""
        return tuple(
            Parameter(name, "mm", self.sigma_mm, f"{name[-1]} of place {k + 1}", nominal=value)
            for k, place in enumerate(self.places_mm)
            for name, value in zip(_names(k), place, strict=True)
        )

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the reported points moved; values in mm, by the parameters' names."""
        if state.seen is None:
            return state
        error_mm = np.array([[values[name] for name in _names(k)] for k in range(len(self.places_mm))])
        places_mm = np.array(self.places_mm)
        away = np.sum((state.seen.scanner_mm[:, None] - places_mm) ** 2, axis=2)
        return state.displace_in_scanner(-error_mm[np.argmin(away, axis=1)])

    def corrected(self, robot: Robot, values: Array) -> Robot:
        """The robot as it is: places are no part of it."""
        return robot

    def _brief(self) -> str:
        return f"{len(self.places_mm)} places"


def _names(k: int) -> tuple[str, ...]:
    return tuple(f"places.{k + 1}{axis}" for axis in "xyz")


def place_errors_of(dataset: Dataset) -> PlaceErrors | None:
    """Errors of a dataset's known places where it declares their size. Raises DatasetError where it has no places."""
    sigma_mm, points = dataset.scanner.place_sigma_mm, dataset.points
    if sigma_mm is None or points is None:
        return None
    places_mm = np.unique(points.xyz_mm, axis=0)
    if len(places_mm) > _MOST or _FEWEST_VISITS * len(places_mm) > len(points):
        raise DatasetError(
            f"dataset {dataset.name}: [scanner] place_sigma_mm is for known places that are visited again and again, "
            f"such as sockets, and its {len(points)} points are at {len(places_mm)} places; leave it out"
        )
    return PlaceErrors(tuple((float(x), float(y), float(z)) for x, y, z in places_mm), sigma_mm)
