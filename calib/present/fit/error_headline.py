"""Headline of a calibration: decrease of the error from the arm as delivered to the last model, and the noise."""

from __future__ import annotations

from collections.abc import Sequence

from calib.calibration.evaluation import Figures
from calib.calibration.noise_level import FIT
from calib.calibration.result import Calibration
from calib.diagnosis.headline import ErrorStage, Headline
from calib.rendering import blocks, numbers

_MICROMETRES_BELOW_MM = 0.1
_FIGURES = (("mean", "mean_mm"), ("RMS", "rmse_mm"), ("maximum", "max_mm"))


def error_headline(headline: Headline, *, unexplained: bool = False) -> blocks.Headline:
    """Headline block with the errors of all stages, the noise, and the note.

    unexplained: whether a diagnosis found that not all of what is left is noise, whatever its size.
    """
    stages = [(stage_error(headline, stage), stage.name) for stage in headline.stages]
    told = note(headline, unexplained=unexplained)
    return blocks.Headline(stages, noise(headline), told, headline.reached_noise and not unexplained)


def unit(headline: Headline) -> str:
    """Unit, "mm" or "µm", for all lengths of one headline."""
    return "µm" if max(stage.error_mm for stage in headline.stages) < _MICROMETRES_BELOW_MM else "mm"


def length(headline: Headline, length_mm: float) -> str:
    """A length in the headline's unit: "0.72 mm"."""
    in_micrometres = unit(headline) == "µm"
    return f"{numbers.digits(1e3 * length_mm if in_micrometres else length_mm)} {unit(headline)}"


def stage_error(headline: Headline, stage: ErrorStage) -> str:
    """The error of a stage in the headline's unit."""
    return length(headline, stage.error_mm)


def noise(headline: Headline) -> str:
    """Phrase with the noise of a headline: "noise 0.0062 mm", or "noise as the fit left it 0.21 mm: not declared"."""
    if headline.noise_mm is None:
        return "noise not declared"
    if headline.noise.is_declared:
        return f"noise {length(headline, headline.noise_mm)}"
    return f"{headline.noise.name} {length(headline, headline.noise_mm)}: not declared"


def note(headline: Headline, *, unexplained: bool = False) -> str:
    """Sentence or two on the poses to which a headline's errors refer, and on whether noise alone is left."""
    error = "3D error" if headline.noise.coordinates == len("xyz") else "Error of the measured lengths"
    of = (
        f"{error} (RMS) at test poses, which no fit saw."
        if headline.of_test_poses
        else f"{error} (RMS) at the poses that were fitted: there are no test poses, so nothing confirms it."
    )
    if headline.tool is not None:
        of += (
            f" The tool point was found {numbers.digits(headline.tool.off_mm)} mm from where robot.toml has it; that "
            "is no error of the arm and counts in none of these figures."
        )
    if headline.stages[-1].error_mm > headline.stages[0].error_mm:
        of += " It rose: the fit is worse than robot.toml as it was, so do not use it."
    ratio = headline.noise_ratio
    if ratio is None or headline.noise_mm is None:
        return f"{of} The dataset declares no noise to compare it with."
    if headline.noise.source == FIT:
        return (
            f"{of} The dataset declares no noise; the error is {numbers.times(ratio)} what the {headline.noise.name} "
            f"would leave, {length(headline, headline.noise_mm)}, and that holds what is missing from the model, too."
        )
    if headline.reached_noise and unexplained:
        return f"{of} By its size what is left could be noise; the verdict says why not all of it is."
    if headline.reached_noise:
        return f"{of} What is left is no more than noise."
    return f"{of} What is left is {numbers.times(ratio)} what noise alone would leave."


def errors_by_stage(headline: Headline, fits: Sequence[Calibration]) -> blocks.Table:
    """Mean, RMS and maximum of the 3D error at each stage of a headline, in one unit."""
    columns: list[Figures] = []
    for stage in headline.stages:
        evaluation = fits[-1].before if stage.step is None else fits[stage.step].after
        figures = evaluation.test if headline.of_test_poses else evaluation.train
        assert figures is not None
        columns.append(figures)
    in_unit, factor = unit(headline), 1e3 if unit(headline) == "µm" else 1.0
    rows = [(name, *(numbers.digits(factor * getattr(f, key)) for f in columns)) for name, key in _FIGURES]
    if headline.noise_mm is not None:
        before_last = [""] * (len(columns) - 1)
        rows.append((f"{headline.noise.name}, RMS", *before_last, numbers.digits(factor * headline.noise_mm)))
    points = numbers.count(columns[0].points, "point")
    of = f"test poses ({points} that no fit saw)" if headline.of_test_poses else f"the fitted poses ({points})"
    headers = (f"3D error, {in_unit}", *(stage.name for stage in headline.stages))
    return blocks.Table(headers, rows, caption=f"Errors at {of}, all in {in_unit}")
