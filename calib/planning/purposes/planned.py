"""A plan for a purpose by its name, starting from whatever is known: a result, a dataset, or the robot alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from calib.calibration.result import FittedResult
from calib.dataset.dataset import Dataset
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import EffectChoice
from calib.effects.effect import Family
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.measurement.measured_dataset import measured
from calib.options import FitFields, FitOptions, fit_options
from calib.planning.fitted_start import start_of_dataset
from calib.planning.plan import Plan, plan_poses
from calib.planning.purpose import CALIBRATION, WATCH, Purpose
from calib.planning.purposes.by_name import purpose_of
from calib.planning.purposes.confounded_effects import SPLIT, for_confounded
from calib.planning.purposes.watching import CHECK_POSES
from calib.planning.start import FromFit, FromRobot
from calib.planning.unknowns import DEFAULT_NOISE_MM
from calib.robot_formats.robots import load_robot
from calib.workcell.known_cell import workcell_of_robot

FIRST_SET, FURTHER = 20, 5
"""Numbers of poses to plan where none is given: for a robot that was never measured, and beyond a dataset."""


def plan(
    known: FittedResult | Dataset | Robot | str | Path,
    count: int | None = None,
    options: FitOptions | None = None,
    *,
    purpose: str = CALIBRATION,
    criterion: str = "I",
    region: str = "auto",
    effects: EffectChoice | Sequence[EffectChoice] = (),
    user_effects: Sequence[Family] = (),
    payload_kg: float | None = None,
    noise_mm: float = DEFAULT_NOISE_MM,
    base_T_scanner: ArrayLike | None = None,
    seed: int = 0,
    on_step: Callable[[str], None] | None = None,
    **keywords: Unpack[FitFields],
) -> Plan:
    """The poses to measure next, in the order of measuring, and the error that a fit to them will have.

    Args:
        known: a calibration or diagnosis, a dataset or its folder, or a robot, its file or its name.
        count: number of poses; None: 20 for a robot, 8 check poses, else 5.
        options: options of the fit of a dataset or robot.
        purpose: "calibration", "watch" (check poses), "split" (effects that a diagnosis could not tell apart), or names
            of effects with commas between.
        criterion: "I" (least error over the region) or "D" (best known parameters), for a calibration.
        region: where the fit is to be right: "auto", "test", "measurable" or "all", see `plan_poses`.
        effects: effects that the model of a dataset has; the diagnosis is then left out.
        user_effects: families beyond the catalogue.
        payload_kg: payload that the arm may carry at some poses, for effects that a load shows.
        noise_mm: standard deviation of a measured point, each axis, for a robot that was never measured.
        base_T_scanner: (4, 4) place of the scanner, where it is put up anew.
        seed: seed of the candidate poses.
        on_step: called with a line of text before each stage of a diagnosis.
        **keywords: fields of `FitOptions`, in place of those of `options`.

    Raises:
        CalibError: too few poses can be measured, or a purpose, effect or option that cannot be planned for.

    >>> import calib
    >>> fit = calib.calibrate("sample_data/hidden_effect_a", effects="transmission_error")
    >>> calib.plan(fit, 3)
    Plan(hidden_effect_a: 3 poses for calibration, predicted RMSE 0.06... -> 0.05... mm)
    """
    options = fit_options(options, keywords)
    place = None if base_T_scanner is None else np.asarray(base_T_scanner, dtype=float)
    start: FromFit | FromRobot
    aim: Purpose | None = None if purpose == SPLIT else purpose_of(purpose, criterion, payload_kg=payload_kg)
    if isinstance(known, str | Path) and Path(known).is_dir():
        known = measured(known, orientation=options.residual == "pose")
    if aim is None:
        split = for_confounded(_diagnosed(known, options, effects, user_effects, on_step), payload_kg)
        aim, start, usual = split, split.start, FURTHER
    else:
        usual = CHECK_POSES if purpose == WATCH else FURTHER
        if isinstance(known, FittedResult):
            start = FromFit(known.calibration, place)
        elif isinstance(known, Dataset):
            start = start_of_dataset(
                known, options, effects=effects, user_effects=user_effects, scanner_place=place, on_step=on_step
            )
        else:
            cell = workcell_of_robot(load_robot(known), base_T_scanner=place)
            start, usual = FromRobot(cell, noise_mm, options), FIRST_SET
    return plan_poses(
        start, usual if count is None else count, purpose=aim, region=region, user_effects=user_effects, seed=seed
    )


def _diagnosed(
    known: FittedResult | Dataset | Robot | str | Path,
    options: FitOptions,
    effects: EffectChoice | Sequence[EffectChoice],
    user_effects: Sequence[Family],
    on_step: Callable[[str], None] | None,
) -> Diagnosis:
    """The diagnosis whose open set is to be settled. Raises CalibError where none can be had."""
    if isinstance(known, Diagnosis):
        return known
    if isinstance(known, Dataset):
        return diagnose(known, options, effects=effects, user_effects=user_effects, on_step=on_step)
    raise CalibError(f'purpose "{SPLIT}" settles what a diagnosis left open; give a diagnosis or a dataset')
