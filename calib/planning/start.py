"""Where a plan begins: a fit of what was measured already, or an arm that was never measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.noise_check import check_sigma
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset, Poses
from calib.effects.effect import Effect
from calib.errors import CalibError
from calib.fitting.observations import conditions_at
from calib.kinematics.robot import Robot
from calib.options import FitOptions
from calib.planning.unknowns import DEFAULT_NOISE_MM, Unknowns, unknowns_of_fit, unknowns_of_robot

NEW_SETUP = "new"


class Start(Protocol):
    """What a plan needs of its beginning."""

    @property
    def dataset(self) -> Dataset:
        """Robot, jig and scanner, with the measured poses where there are any."""
        ...

    @property
    def measured(self) -> Poses | None:
        """The poses that were measured already, test poses too."""
        ...

    @property
    def setup(self) -> str:
        """The placement of the scanner that new poses are measured from."""
        ...

    @property
    def base_T_scanner(self) -> Array:
        """(4, 4) where that is, in the base frame."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed, and what a prediction cannot know, a sentence each."""
        ...

    def unknowns(self, effects: Sequence[Effect] = ()) -> Unknowns:
        """The unknowns of the fit to come, these effects among them."""
        ...

    def poses_at(self, q: Array) -> Poses:
        """Poses to be measured at joints (N, n), under the usual conditions."""
        ...


@dataclass(frozen=True)
class FromFit:
    """The next poses of a calibration; from where its scanner stood last, or from a further place."""

    calibration: Calibration
    scanner_place: Array | None = None  # (4, 4) base_T_scanner of a placement that was not measured from yet
    assumed: tuple[str, ...] = ()  # sentences for `notes`

    @property
    def dataset(self) -> Dataset:
        return self.calibration.dataset

    @property
    def measured(self) -> Poses:
        return self.calibration.dataset.poses

    @property
    def setup(self) -> str:
        names = [str(name) for name in self.measured.setup]
        if self.scanner_place is None:
            points = self.calibration.fitted_dataset.points
            assert points is not None
            trained = points.pose[~self.measured.is_test[points.pose]] if len(points) else points.pose
            return names[int(trained[np.argmax(self.measured.order[trained])])]
        number = 1
        while (name := NEW_SETUP if number == 1 else f"{NEW_SETUP}{number}") in names:
            number += 1
        return name

    @property
    def base_T_scanner(self) -> Array:
        if self.scanner_place is not None:
            return self.scanner_place
        return frames.invert(self.calibration.after.scanner_T_base[self.setup])

    @property
    def notes(self) -> tuple[str, ...]:
        out = [*self.assumed]
        check = check_sigma(self.calibration)
        if check.verdict == "excess" and check.declared_mm:
            ratio = check.sigma_mm / check.declared_mm
            out.append(
                f"the fit leaves {ratio:.3g} times the declared noise, so something is missing from the model: the "
                "prediction is of its parameters alone, and what is missing may be the larger part away from the "
                "measured poses"
            )
        elif check.verdict == "unknown":
            out.append("no noise of the points is declared: what the fit leaves over is taken for noise")
        if self.calibration.residual != "position":
            out.append(f"planned as for a fit of positions; this one is of {self.calibration.residual}")
        return tuple(out)

    def unknowns(self, effects: Sequence[Effect] = ()) -> Unknowns:
        further = None if self.scanner_place is None else {self.setup: frames.invert(self.scanner_place)}
        return unknowns_of_fit(self.calibration, effects=effects, scanner_T_base=further)

    def poses_at(self, q: Array) -> Poses:
        poses = conditions_at(self.measured, q)
        return replace(poses, role=np.full(len(q), "train"), setup=np.full(len(q), self.setup))


@dataclass(frozen=True)
class FromRobot:
    """A first set of poses for an arm."""

    robot: Robot
    base_T_scanner: Array  # (4, 4), roughly
    noise_mm: float = DEFAULT_NOISE_MM  # of a measured point, each axis
    options: FitOptions = field(default_factory=FitOptions)
    assumed: tuple[str, ...] = ()  # sentences for `notes`

    @property
    def dataset(self) -> Dataset:
        none = np.zeros((0, self.robot.n_joints))
        return Dataset(self.robot.name, self.robot, self.poses_at(none))

    @property
    def measured(self) -> None:
        return None

    @property
    def setup(self) -> str:
        return ""

    @property
    def notes(self) -> tuple[str, ...]:
        said = f"{self.noise_mm:g} mm of noise a coordinate of a measured point, and errors within their tolerances"
        return (f"assumed: {said}", *self.assumed)

    def unknowns(self, effects: Sequence[Effect] = ()) -> Unknowns:
        if not self.options.prior:
            raise CalibError("a first set of poses is planned with tolerances; leave out --no-prior")
        return unknowns_of_robot(
            self.robot,
            self.base_T_scanner,
            noise_mm=self.noise_mm,
            effects=effects,
            tolerances=self.options.tolerances,
            held=self.options.held,
        )

    def poses_at(self, q: Array) -> Poses:
        n = len(q)
        ids = tuple(f"q{i + 1}" for i in range(n))
        return Poses(ids, np.full(n, "train"), q, np.full(n, ""), ids)
