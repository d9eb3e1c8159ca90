"""Reading of model.json, a fitted model as a file, format version 1 (`model_document`).

The file holds no code: members of effects are made from their family's name and plain fields (`effect_fields`), and a
user's effects come from the user's file. Every value is checked; a file that cannot be used raises a one-line error.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from calib.array_types import Array
from calib.calibration.result import FittedResult
from calib.compensation.target_correction import plain_poses
from calib.dataset.dataset import Poses
from calib.dataset.files.origin import Origin
from calib.dataset.files.robot_toml import refuse_beyond
from calib.dataset.further_columns import FurtherColumns
from calib.dataset.trained_range import TrainedRange
from calib.effects.catalogue.user_file import load_effects
from calib.effects.effect import Effect
from calib.effects.state import RobotState, Seen
from calib.errors import CalibError, FitError, ModelFileError
from calib.fitting.discrepancy import Discrepancy
from calib.fitting.model import Model
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import with_own_tool_point
from calib.models.effect_fields import member_from
from calib.models.fitted_model import FittedModel, Source
from calib.models.model_document import KIND, VERSION, ModelDocument, Row, SavedOptions
from calib.options import FitOptions
from calib.strict_json import JsonFile, Text

LARGEST_VARIANCE = 1e12  # mm^2, rad^2, ...: far beyond what any fit leaves open
SIZE_LIMIT = 100_000_000  # bytes; a thousand parameters are 10 MB
_SAME = 1e-9  # mm or rad; largest difference of the table from robot and parameters


def save_model(fitted: FittedResult | FittedModel, path: str | Path) -> None:
    """Write a fitted model as model.json, whole or not at all; `load_model` reads it and predicts the same.

    Raises CalibError for a user's effect that cannot be saved.

    >>> import calib
    >>> calib.save_model(calib.calibrate("sample_data/hidden_effect_a"), "model.json")
    >>> calib.load_model("model.json")
    FittedModel(RB5-850, fitted to hidden_effect_a: test RMSE 2.32 -> 0.415 mm, effects: none)
    """
    fitted.save(path)


def load_model(path: str | Path, effects_file: str | Path | None = None) -> FittedModel:
    """A fitted model from a model.json, which predicts and corrects without its dataset.

    Args:
        path: written by `save_model`, `Calibration.save` or a command's --model-out.
        effects_file: the user's own effects, where the model has some.

    Raises:
        ModelFileError: names the file and the place in it, what was found, and what is needed.
        CalibError: the effects file cannot be used.

    >>> import calib
    >>> fit = calib.calibrate("sample_data/hidden_effect_a")
    >>> fit.save("model.json")
    >>> calib.load_model("model.json").predict([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]]).round(1).tolist()
    [[...]]
    """
    file = JsonFile(Path(path), "model file", "write the model again", ModelFileError, SIZE_LIMIT)
    document = file.checked([], file.read(KIND, VERSION), ModelDocument)
    robot = _robot(file, document)
    trial = _trial_state(robot, document.needs)
    users = () if effects_file is None else load_effects(Path(effects_file), trial)
    effects = [
        member_from(file, ["effects", i], msgspec.to_builtins(member), robot, users)
        for i, member in enumerate(document.effects)
    ]
    options = _options(file, document)
    model = _model(file, document, robot, effects, options)
    x = np.array([parameter.change for parameter in document.parameters])
    _try(file, model, x, trial)
    _require_table(file, document, model, x)
    key = "scanner_T_flange" if robot.carries_scanner else "scanner_T_base"
    placed = document.scanner_T_flange if robot.carries_scanner else document.scanner_T_base
    sigma = [math.inf if p.sigma is None else p.sigma for p in document.parameters]
    return FittedModel(
        model=model,
        x=x,
        covariance=_covariance(file, document, len(x)),
        sigma=np.array(sigma),
        options=options,
        scanner_T_base={name: _frame(file, key, name, value) for name, value in placed.items()},
        needs=document.needs,
        before=document.before,
        after=document.after,
        sigma_mm=math.nan if document.sigma_mm is None else document.sigma_mm,
        source=Source(
            document.dataset.name,
            document.dataset.training_poses,
            Origin.read(
                document.origin,
                document.program_version,
                file.checked_values(["dataset", "files"], document.dataset.files, Text),
            ),
            document.dataset.left_out,
        ),
        trained=_trained(file, document, robot),
        discrepancy=_discrepancy(file, document, robot),
    )


def _trained(file: JsonFile, document: ModelDocument, robot: Robot) -> TrainedRange | None:
    if document.trained is None:
        return None
    low, high = document.trained.low, document.trained.high
    if not len(low) == len(high) == robot.n_joints or any(a > b for a, b in zip(low, high, strict=True)):
        file.fail(["trained"], f"{list(low)} to {list(high)}", f"a range of each of {robot.n_joints} joints is needed")
    return TrainedRange(low, high)


def _discrepancy(file: JsonFile, document: ModelDocument, robot: Robot) -> Discrepancy | None:
    saved = document.discrepancy
    if saved is None:
        return None
    if not saved.trained or any(len(row) != robot.n_joints for row in saved.trained):
        file.fail(
            ["discrepancy", "trained"], "other joint vectors", f"one or more of {robot.n_joints} joints are needed"
        )
    if len(saved.scale) != robot.n_joints or min(saved.scale) <= 0.0:
        file.fail(["discrepancy", "scale"], f"{list(saved.scale)}", f"{robot.n_joints} numbers above 0 are needed")
    return Discrepancy(saved.constant_mm2, saved.growth_mm2, np.array(saved.trained), np.array(saved.scale))


def _robot(file: JsonFile, document: ModelDocument) -> Robot:
    robot = file.checked(["robot"], document.robot, Robot)
    if not robot.joints:
        file.fail(["robot", "joints"], "none", "a robot has at least one joint")
    for i, joint in enumerate(robot.joints):
        if joint.type not in ("revolute", "prismatic"):
            file.fail(["robot", "joints", i, "type"], repr(joint.type), "revolute or prismatic is needed")
    n = robot.n_joints
    if robot.coupling and [len(row) for row in robot.coupling] != [n] * n:
        file.fail(["robot", "coupling"], f"{len(robot.coupling)} rows", f"{n} rows of {n} numbers are needed")
    refuse_beyond(robot, file.path)
    return robot


def _options(file: JsonFile, document: ModelDocument) -> FitOptions:
    try:
        options = file.checked(["options"], document.options, SavedOptions).options()
    except FitError as error:  # of a value that no fit can have
        raise ModelFileError(f"{file.path}: {str(error).replace('option ', 'options.', 1)}") from None
    if options.noise is not None and not options.noise.is_possible:
        file.fail(["options", "noise"], repr(options.noise)[:200], "a shape that noise can have is needed")
    return options


def _model(
    file: JsonFile, document: ModelDocument, robot: Robot, effects: Sequence[Effect], options: FitOptions
) -> Model:
    """Fitted model made from a file's content. Raises the file's error where parameters and effects do not match."""
    loads = None
    if document.loads_table is not None:
        loads = robot.with_table(_table(file, "loads_table", document.loads_table, robot))
    sigmas = {parameter.name: parameter.prior_sigma for parameter in document.parameters}
    found_tool = None
    if document.found_tool_mm is not None:
        if len(document.found_tool_mm) != 3:
            file.fail(["found_tool_mm"], f"{len(document.found_tool_mm)} numbers", "x, y and z are needed")
        found_tool = with_own_tool_point(robot, document.found_tool_mm)
    means = {} if options.type_prior is None else options.type_prior.means
    model = Model(robot, tuple(effects), frozenset(document.held), sigmas, loads, found_tool, means)
    found = [p.name for p in document.parameters]
    if len(set(found)) < len(found):
        file.fail(["parameters"], "one name twice", "each parameter has its own")
    expected = [p.name for p in model.parameters]
    if found != expected:
        differing = [i for i, (a, b) in enumerate(zip(found, expected, strict=False)) if a != b]
        i = differing[0] if differing else min(len(found), len(expected))
        name = repr(found[i]) if i < len(found) else "nothing"
        needed = repr(expected[i]) if i < len(expected) else "no further parameter"
        file.fail(["parameters", i, "name"], name, f"these effects have {needed} there")
    return model


def _table(file: JsonFile, key: str, rows: Sequence[Row], robot: Robot) -> Array:
    shape = robot.table.shape
    if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
        file.fail([key], f"{len(rows)} rows", f"{shape[0]} rows of {shape[1]} numbers are needed")
    return np.array(rows)


def _require_table(file: JsonFile, document: ModelDocument, model: Model, x: Array) -> None:
    """Raise the file's error where the table, which is for readers only, was edited and contradicts the parameters."""
    table = _table(file, "table", document.table, model.robot)
    off = np.abs(table - model.calibrated_robot(x).table)
    if off.max() > _SAME:
        row, column = np.unravel_index(int(np.argmax(off)), off.shape)
        file.fail(
            ["table", int(row), int(column)],
            f"{table[row, column]:g}",
            "it is not what robot and parameters give; change the parameters, or calibrate again",
        )


def _covariance(file: JsonFile, document: ModelDocument, size: int) -> Array:
    rows = document.covariance
    if [len(row) for row in rows] != list(range(1, size + 1)):
        file.fail(["covariance"], f"{len(rows)} rows", f"{size} rows of 1 to {size} numbers are needed")
    out = np.zeros((size, size))
    for i, row in enumerate(rows):
        out[i, : i + 1] = out[: i + 1, i] = row
    variance = out.diagonal()
    possible = (variance >= 0.0) & (variance < LARGEST_VARIANCE)
    sigma = np.sqrt(np.where(possible, variance, 0.0))
    wrong = np.argwhere((np.abs(out) > 1.001 * np.outer(sigma, sigma) + 1e-12) | np.diag(~possible))
    if len(wrong):
        i, j = map(int, wrong[0])
        file.fail(["covariance", i, j], f"{out[i, j]:g}", "no covariance has such an entry")
    return out


def _frame(file: JsonFile, key: str, name: str, value: Any) -> Array:
    place: list[str | int] = [key, name]
    rows = file.checked(place, value, tuple[Row, ...])
    if [len(row) for row in rows] != [4] * 4:
        file.fail(place, f"{len(rows)} rows", "4 rows of 4 numbers are needed")
    frame = np.array(rows)
    turn = frame[:3, :3]
    rigid = np.abs(turn).max() <= 2.0 and np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)
    if not (rigid and np.linalg.det(turn) > 0.0 and np.array_equal(frame[3], [0.0, 0.0, 0.0, 1.0])):
        file.fail(place, "no rigid motion", "a rotation and a translation are needed")
    return frame


def _trial_state(robot: Robot, needs: Sequence[str]) -> RobotState:
    """State of the nominal robot at two poses with all conditions, on which a file's effects are tried."""
    q = np.zeros((2, robot.n_joints))
    q[1] = 0.1
    extra = FurtherColumns({name: np.zeros(2) for name in needs})
    poses: Poses = dataclasses.replace(
        plain_poses(q),
        payload_kg=np.zeros(2),
        temperature_c=np.full(2, 20.0),
        time_s=np.arange(2.0),
        approach=np.ones_like(q),
        extra=extra,
    )
    seen = Seen(np.full((2, 3), 100.0), np.broadcast_to(np.eye(4), (2, 4, 4)))
    return RobotState.nominal(robot, poses, seen)


def _try(file: JsonFile, model: Model, x: Array, trial: RobotState) -> None:
    """Predict once, to raise the file's error for fields and values that no fit gives, such as a surplus joint."""
    try:
        with np.errstate(all="ignore"):
            points_mm = dataclasses.replace(model.at_tool, of_arm_alone=False).predict(x, trial.poses, seen=trial.seen)
    except CalibError as error:  # a user's effect
        raise ModelFileError(f"{file.path}: {error}") from None
    except (ArithmeticError, LookupError, TypeError, ValueError, AttributeError) as error:
        file.fail(["effects"], type(error).__name__, "a member has fields that do not fit this arm")
    if not np.isfinite(points_mm).all():
        file.fail(["parameters"], "values at which no place can be predicted", "calibrate again")
