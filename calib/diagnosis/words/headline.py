"""The headline of a calibration: how far the arm is off as delivered, with calibrated links, with each effect.

The page, the report and the terminal take it from here, as data or as one line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from calib.calibration.noise_level import FIT, NoiseLevel, noise_level
from calib.calibration.result import Calibration
from calib.diagnosis.words.conclusions import HeldOutError
from calib.diagnosis.words.phrases import length_digits, listed, times_text
from calib.fitting.tool_point import ToolShift
from calib.screening.curves.smooth_joint_error import LEARNED

NOISE_AGREES = 1.5  # times the noise: up to this an error is what noise leaves, as few poses can tell
_MICROMETRES_BELOW_MM = 0.1


@dataclass(frozen=True)
class ErrorStage:
    """One model on the way, and how far it is off."""

    name: str  # "as delivered", "with calibrated links", "with joint_compliance"
    error_mm: float  # 3D RMSE
    step: int | None  # which of the calibrations it is of; None for the arm as delivered
    effects: tuple[str, ...] = ()  # that this stage added


@dataclass(frozen=True)
class Headline:
    """The way from the arm as delivered to the last model, and what noise alone would leave."""

    stages: tuple[ErrorStage, ...]  # the arm as delivered first
    noise: NoiseLevel
    of_test_poses: bool  # else there are none, and the errors are of the poses that were fitted
    tool: ToolShift | None = None  # where the tool point was found, where robot.toml has it far off

    @property
    def noise_mm(self) -> float | None:
        """3D RMSE that noise alone leaves; None where it is not known."""
        return self.noise.floor_mm

    @property
    def noise_ratio(self) -> float | None:
        """The last error over the noise; None where that is not known."""
        return self.stages[-1].error_mm / self.noise_mm if self.noise_mm else None

    @property
    def reached_noise(self) -> bool:
        """Whether the last error is what noise leaves. Never so where the fit alone tells the noise."""
        ratio = self.noise_ratio
        return ratio is not None and self.noise.source != FIT and ratio <= NOISE_AGREES

    @property
    def unit(self) -> str:
        """ "mm" or "µm": one unit for all its lengths."""
        return "µm" if max(stage.error_mm for stage in self.stages) < _MICROMETRES_BELOW_MM else "mm"

    def shown(self, length_mm: float) -> str:
        """A length as the headline tells it: "0.72 mm"."""
        return f"{length_digits(1e3 * length_mm if self.unit == 'µm' else length_mm)} {self.unit}"


def headline_of(calibrations: Sequence[Calibration]) -> Headline:
    """The headline of fits that led to the last one; those of effects which are no longer in the model are left out.

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
        name = _name(new, with_links=len(stages) == 1)
        stages.append(ErrorStage(name, _error_mm(calibrations[step], of_test_poses), step, new))
        inside = effects
    return Headline(tuple(stages), noise_level(last), of_test_poses, last.tool_shift)


def _on_the_way(effects: Sequence[tuple[str, ...]]) -> list[int]:
    """Which models, by their effects, lead to the last one by adding alone; of equal ones the later."""
    way: list[int] = []
    for step in range(len(effects) - 1, -1, -1):
        if not way or set(effects[step]) < set(effects[way[-1]]):
            way.append(step)
    return way[::-1]


def _name(new: Sequence[str], *, with_links: bool) -> str:
    links = ["calibrated links"] if with_links else []
    return f"with {listed([*links, *('learned curves' if name == LEARNED else name for name in new)])}"


def _error_mm(calibration: Calibration, of_test_poses: bool, *, before: bool = False) -> float:
    """3D RMSE of the test poses, or of the training poses; nan where there are none."""
    evaluation = calibration.before if before else calibration.after
    figures = evaluation.test if of_test_poses else evaluation.train
    return figures.rmse_mm if figures is not None else math.nan


def held_out_beyond_noise(calibration: Calibration, noise_mm: float) -> HeldOutError | None:
    """The test poses' error, where it is larger than noise of this sigma a coordinate would leave; else None."""
    test = calibration.after.test
    if test is None or not noise_mm > 0.0 or test.rmse_mm <= NOISE_AGREES * math.sqrt(3.0) * noise_mm:
        return None
    return HeldOutError(test.rmse_mm, test.rmse_mm / (math.sqrt(3.0) * noise_mm))


def headline_text(told: Headline) -> str:
    """ "1.92 mm as delivered → 0.72 mm with calibrated links → 0.040 mm with joint_compliance (noise 0.0062 mm)"."""
    way = " → ".join(f"{told.shown(stage.error_mm)} {stage.name}" for stage in told.stages)
    return f"{way} ({noise_words(told)})"


def noise_words(told: Headline) -> str:
    """ "noise 0.0062 mm", or "noise as the fit left it 0.21 mm: not declared"."""
    if told.noise_mm is None:
        return "noise not declared"
    if told.noise.is_declared:
        return f"noise {told.shown(told.noise_mm)}"
    return f"{told.noise.name} {told.shown(told.noise_mm)}: not declared"


def headline_note(told: Headline) -> str:
    """Which poses the figures are of, and whether noise alone is left, in a sentence or two."""
    of = (
        "3D error (RMS) at test poses, which no fit saw."
        if told.of_test_poses
        else "3D error (RMS) at the poses that were fitted: there are no test poses, so nothing confirms it."
    )
    if told.tool is not None:
        of += (
            f" The tool point was found {length_digits(told.tool.off_mm)} mm from where robot.toml has it; that is no "
            "error of the arm and counts in none of these figures."
        )
    if told.stages[-1].error_mm > told.stages[0].error_mm:
        of += " It rose: the fit is worse than robot.toml as it was, so do not put it on the robot."
    ratio = told.noise_ratio
    if ratio is None or told.noise_mm is None:
        return f"{of} The dataset declares no noise to compare it with."
    if told.noise.source == FIT:
        return (
            f"{of} The dataset declares no noise; what is left is {times_text(ratio)} what the {told.noise.name} "
            f"would leave, {told.shown(told.noise_mm)}, and that holds what is missing from the model, too."
        )
    if told.reached_noise:
        return f"{of} What is left is no more than noise."
    return f"{of} What is left is {times_text(ratio)} what noise alone would leave."
