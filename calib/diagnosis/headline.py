"""The errors of an arm as delivered, with calibrated links and with each effect added, for a headline."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from calib.calibration.noise_level import FIT, NoiseLevel, noise_level
from calib.calibration.result import Calibration
from calib.dataset.repeats import SIGMA_DOUBT
from calib.effects.effect import PartOf, family_name, part_of
from calib.fitting.tool_point import ToolShift
from calib.rendering import numbers
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.statistics import chi2_sf

NOISE_AGREES = 1.5  # times the noise: up to this an error may be what noise leaves, where few points tell of it
_CHANCE = 0.01  # that noise alone leaves as much


def noise_agrees(ratio: float, coordinates: int) -> bool:
    """Whether an error that is `ratio` times what noise leaves may be noise, with so many coordinates to tell it by.

    Noise is taken as accurate to 25 %. Of ten points an error of 1.5 times the noise may be noise; of sixty it is not.
    """
    return ratio <= NOISE_AGREES and chi2_sf(coordinates * (ratio / SIGMA_DOUBT) ** 2, coordinates) >= _CHANCE


@dataclass(frozen=True)
class ErrorStage:
    """A stage of the headline: a model, from the arm as delivered to the last fit, with its error."""

    name: str  # "as delivered", "with calibrated links", "with joint_compliance"
    error_mm: float  # 3D RMSE
    step: int | None  # index of its calibration; None for the arm as delivered
    effects: tuple[str, ...] = ()  # that this stage added
    of: PartOf = "arm"  # what these are a part of; several parts count as the arm


@dataclass(frozen=True)
class Headline:
    """Errors of an arm from stage to stage (as delivered, calibrated links, effects), and the error by noise alone."""

    stages: tuple[ErrorStage, ...]  # the arm as delivered first
    noise: NoiseLevel
    of_test_poses: bool  # else there are none, and the errors are of the poses that were fitted
    points: int = 1  # that the last stage's error is of
    tool: ToolShift | None = None  # where the tool point was found, where robot.toml has it far off
    fits_links: bool = True  # else nothing was found of the arm itself

    @property
    def noise_mm(self) -> float | None:
        """3D RMSE that noise alone causes, mm; None where it is not known."""
        return self.noise.floor_mm

    @property
    def noise_ratio(self) -> float | None:
        """Ratio of the last stage's error to the error by noise alone; None where the noise is not known."""
        return self.stages[-1].error_mm / self.noise_mm if self.noise_mm else None

    @property
    def reached_noise(self) -> bool:
        """Whether the last stage's error is no larger than independently known noise explains."""
        ratio = self.noise_ratio
        if ratio is None or self.noise.source == FIT:
            return False
        return noise_agrees(ratio, self.noise.coordinates * self.points)


@dataclass(frozen=True)
class HeldOutError:
    """Error of the test poses, with its ratio to the error by noise alone."""

    rmse_mm: float  # 3D
    noise_ratio: float  # of `rmse_mm` to what noise alone leaves


def headline_of(calibrations: Sequence[Calibration]) -> Headline:
    """Headline of a sequence of fits, without fits whose effects are no longer in the last model.

    Args:
        calibrations: of one dataset, at least one, in the order that they were made.
    """
    last = calibrations[-1]
    of_test_poses = last.before.test is not None and last.after.test is not None
    stages = [ErrorStage("as delivered", _error_mm(last, of_test_poses, before=True), None)]
    inside: tuple[str, ...] = ()
    for step in _on_the_way([calibration.model.family_names for calibration in calibrations]):
        effects = calibrations[step].model.family_names
        new = tuple(name for name in effects if name not in inside)
        links = ("calibrated links" if last.fits_links else "links held") if len(stages) == 1 else ""
        name = _name(new, links)
        parts = {part_of(member) for member in calibrations[step].model.added_effects if family_name(member) in new}
        of = parts.pop() if len(parts) == 1 else "arm"
        stages.append(ErrorStage(name, _error_mm(calibrations[step], of_test_poses), step, new, of))
        inside = effects
    figures = last.after.test if of_test_poses else last.after.train
    points = 1 if figures is None else figures.points
    return Headline(tuple(stages), noise_level(last), of_test_poses, points, last.tool_shift, last.fits_links)


def _on_the_way(effects: Sequence[tuple[str, ...]]) -> list[int]:
    """Indices of the fits whose effects grow by additions alone up to the last; of equal models the later one."""
    way: list[int] = []
    for step in range(len(effects) - 1, -1, -1):
        if not way or set(effects[step]) < set(effects[way[-1]]):
            way.append(step)
    return way[::-1]


def _name(new: Sequence[str], links: str) -> str:
    parts = [*([links] if links else []), *("learned curves" if n == LEARNED else n for n in new)]
    return f"with {numbers.listing(parts)}"


def _error_mm(calibration: Calibration, of_test_poses: bool, *, before: bool = False) -> float:
    """3D RMSE, mm, of a calibration's test poses, or of its training poses; nan where there are none."""
    evaluation = calibration.before if before else calibration.after
    return evaluation.test_rmse_mm if of_test_poses else evaluation.train_rmse_mm


def held_out_beyond_noise(calibration: Calibration, noise_mm: float) -> HeldOutError | None:
    """Error of the test poses where it exceeds the error by noise of `noise_mm` per coordinate; else None."""
    test, points = calibration.after.test, calibration.dataset.points
    assert points is not None
    by_noise_mm = math.sqrt(points.coordinates) * noise_mm
    if test is None or not noise_mm > 0.0:
        return None
    ratio = test.rmse_mm / by_noise_mm
    if noise_agrees(ratio, points.coordinates * test.points):
        return None
    return HeldOutError(test.rmse_mm, ratio)
