"""Poses to measure next, from whatever is known: `calib.plan`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from calib.api.loading import options_with
from calib.calibration.result import FittedResult
from calib.dataset.dataset import Dataset
from calib.diagnosis.diagnose import whole_diagnosis
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace
from calib.effects.catalogue import EffectChoice, effects_named
from calib.effects.effect import Family
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.measurement.measured_dataset import measured
from calib.options import FitFields, FitOptions, fit_options
from calib.planning.criterion import PlanTask
from calib.planning.plan import FIRST_SET, Plan, criterion_of, plan_poses, task_of_diagnosis
from calib.planning.purpose import CALIBRATION, FURTHER, PlanPurpose, purposes
from calib.planning.start import FromFit, FromRobot, start_of_dataset
from calib.planning.unknowns import DEFAULT_NOISE_MM
from calib.progress import OnStep
from calib.robot_formats.robots import load_robot
from calib.screening.blunders import without_blunders
from calib.workcell.known_cell import workcell_of_robot


def plan(
    known: FittedResult | Dataset | Robot | str | Path,
    count: int | None = None,
    options: FitOptions | None = None,
    *,
    purpose: str = CALIBRATION,
    region: str = "auto",
    effects: EffectChoice | Sequence[EffectChoice] = (),
    user_effects: Sequence[Family] = (),
    payload_kg: float | None = None,
    noise_mm: float = DEFAULT_NOISE_MM,
    base_T_scanner: ArrayLike | None = None,
    seed: int = 0,
    on_step: OnStep | None = None,
    **keywords: Unpack[FitFields],
) -> Plan:
    """Plan of the poses to measure next, with the predicted error of a fit to them.

    Args:
        known: a calibration or diagnosis, a dataset or its folder, or a robot, its file or its name.
        count: number of poses; None: 20 for a robot, else 5, or what the purpose takes.
        options: options of the fit of a dataset or robot.
        purpose: "calibration", "split" (effects that a diagnosis left confounded), one that a plug-in brings ("watch",
            check poses; "prove", a cause by changing a condition), or names of effects with commas between.
        region: poses at which the error is predicted: "auto", "test", "measurable" or "all", see `plan_poses`.
        effects: effects that the model of a dataset has; the diagnosis is then left out.
        user_effects: families beyond the catalogue.
        payload_kg: payload that the arm may carry at some poses, for effects that a load shows.
        noise_mm: standard deviation per coordinate of a measured point, mm, for a robot that was never measured.
        base_T_scanner: (4, 4) pose of the scanner beside a robot that was never measured; None: before the arm.
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
    if isinstance(known, Dataset) or (isinstance(known, str | Path) and Path(known).is_dir()):
        known, options = options_with(known, options, keywords)
    else:
        options = fit_options(options, keywords)
    scanner = None if base_T_scanner is None else np.asarray(base_T_scanner, dtype=float)
    asked = purposes().get(purpose)
    design = None if asked and asked.of_diagnosis else criterion_of(purpose, payload_kg=payload_kg)
    if isinstance(known, Dataset):
        known = measured(known, orientation=options.residual == "pose")
    robot = None
    if not isinstance(known, Dataset | FittedResult):
        robot = FromRobot(workcell_of_robot(load_robot(known), base_T_scanner=scanner), noise_mm, options)
    elif scanner is not None:
        raise CalibError("further poses are measured from where the scanner stood last; leave out base_T_scanner")
    if asked and design is None:
        known = _diagnosed(known, asked, options, effects, user_effects, on_step)
        task = task_of_diagnosis(asked, known, count, payload_kg)
    else:
        assert design is not None
        usual = FURTHER if asked is None else asked.usual_count
        start: FromFit | FromRobot
        if robot is not None:
            start, usual = robot, FIRST_SET
        elif isinstance(known, FittedResult):
            start = FromFit(without_blunders(known.calibration))
        else:
            assert isinstance(known, Dataset)
            members = effects_named(known, effects, user_effects)
            start = start_of_dataset(known, options, effects=members, user_effects=user_effects, on_step=on_step)
        task = PlanTask(start, usual if count is None else count, design)
    return plan_poses(
        task.start, task.count, criterion=task.criterion, region=region, user_effects=user_effects, seed=seed
    )


def _diagnosed(
    known: FittedResult | Dataset | Robot | str | Path,
    purpose: PlanPurpose,
    options: FitOptions,
    effects: EffectChoice | Sequence[EffectChoice],
    user_effects: Sequence[Family],
    on_step: OnStep | None,
) -> Diagnosis:
    """Diagnosis to plan from, made if a dataset is given. Raises CalibError for anything else."""
    if isinstance(known, Diagnosis):
        return known
    if isinstance(known, Dataset):
        members = effects_named(known, effects, user_effects)
        space = SearchSpace.of(known, options, given=members, user_effects=user_effects)
        return whole_diagnosis(space, on_step)
    raise CalibError(
        f'purpose "{purpose.name}" is for effects left confounded by a diagnosis; give a diagnosis or a dataset'
    )
