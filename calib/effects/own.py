"""A user's own effects, from a file of theirs, checked before they are used.

The file is Python. Either it has `EFFECTS`, a tuple of effects, or every class in it that has `parameters` and `apply`
is taken: a dataclass with a field `joint` once for each joint, one without fields once.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
import traceback
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from calib.dataset import Dataset
from calib.effects.base import Effect, Parameter, apply_values, family_name
from calib.effects.catalogue import Family, families_from
from calib.effects.descriptions import FAMILY_NAMES
from calib.effects.state import RobotState
from calib.errors import CalibError
from calib.model import geometric_model
from calib.observations import Observations, place_scanner


def load_effects(path: Path, dataset: Dataset) -> tuple[Family, ...]:
    """The families of an effects file, made for a dataset's robot. Raises CalibError in one line."""
    module = _load(path)
    effects = tuple(getattr(module, "EFFECTS", ())) or tuple(_instances(path, module, dataset.robot.n_joints))
    if not effects:
        raise CalibError(
            f"{path}: found no effect; define a class with `parameters` and `apply`, or a tuple EFFECTS"
        )
    return check_effects(effects, dataset, str(path))


def check_effects(effects: Iterable[Effect], dataset: Dataset, where: str = "effects") -> tuple[Family, ...]:
    """The effects as families, after a trial on the dataset's poses. Raises CalibError in one line."""
    effects = tuple(effects)
    state = _trial_state(dataset)
    for effect in effects:
        _check(effect, state, where)
    families = families_from(effects)
    for family in families:
        if family.name in FAMILY_NAMES:
            raise CalibError(
                f"{where}: effect {family.name!r} has the name of one in the catalogue; give it another `name`"
            )
    return families


def _load(path: Path) -> ModuleType:
    if not path.is_file():
        raise CalibError(f"{path}: no such effects file")
    spec = importlib.util.spec_from_file_location(f"_effects_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise CalibError(f"{path}: not a Python file; an effects file ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    try:
        # Not by the loader: a file that was saved twice within a second would come out of its cache as it was before.
        exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)
    except SyntaxError as error:
        raise CalibError(f"{path}: line {error.lineno}: {error.msg}; mend the syntax") from None
    except Exception as error:
        raise CalibError(
            f"{path}: line {_line(error, path)}: {type(error).__name__}: {_one_line(error)}"
        ) from None
    return module


def _instances(path: Path, module: ModuleType, joints: int) -> Iterable[Effect]:
    for value in vars(module).values():
        if not isinstance(value, type) or value.__module__ != module.__name__:
            continue
        if not (hasattr(value, "apply") and hasattr(value, "parameters")):
            continue
        needed = [
            f.name
            for f in (dataclasses.fields(value) if dataclasses.is_dataclass(value) else ())
            if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        ]
        if needed == ["joint"]:
            yield from (value(joint=j) for j in range(joints))
        elif not needed:
            yield value()
        else:
            raise CalibError(
                f"{path}: {value.__name__} needs {', '.join(needed)}; only `joint` is filled in, use EFFECTS for more"
            )


def _trial_state(dataset: Dataset) -> RobotState:
    nominal = geometric_model(dataset.robot)
    observed = place_scanner(Observations.of(dataset), nominal, np.zeros(len(nominal.parameters)))
    return RobotState.nominal(dataset.robot, observed.used_poses[0], observed.seen())


def _check(effect: Any, state: RobotState, where: str) -> None:
    label = f"{where}: effect {type(effect).__name__}"
    parameters = getattr(effect, "parameters", None)
    if not isinstance(parameters, tuple | list) or not parameters:
        raise CalibError(f"{label}: `parameters` is {parameters!r}; a tuple of Parameter is needed")
    for p in parameters:
        if (
            not isinstance(p, Parameter)
            or not p.name.isidentifier()
            or not (np.isfinite(p.scale) and p.scale > 0)
        ):
            raise CalibError(
                f"{label}: {p!r} is no Parameter with an identifier for a name and a scale above 0"
            )
    if len({p.name for p in parameters}) < len(parameters):
        raise CalibError(f"{label}: two parameters have the same name")
    zero = np.zeros(len(parameters))
    after = _applied(effect, state, zero, label)
    if not np.array_equal(np.broadcast_to(state.vector, after.shape), after):
        raise CalibError(
            f"{label}: with all parameters zero it still changes the state; zero has to mean absent"
        )
    for k, p in enumerate(parameters):
        one = zero.copy()
        one[k] = p.scale
        _applied(effect, state, one, label)


def _applied(effect: Effect, state: RobotState, values: np.ndarray, label: str) -> np.ndarray:
    try:
        with np.errstate(all="ignore"):  # what is not finite is told below
            after = apply_values(effect, state, values)
    except Exception as error:
        raise CalibError(f"{label}: `apply` fails with {type(error).__name__}: {_one_line(error)}") from None
    if not isinstance(after, RobotState):
        raise CalibError(
            f"{label}: `apply` returns {type(after).__name__}; return the state that `state.add_...` gives"
        )
    try:
        vector = after.vector
    except ValueError as error:
        raise CalibError(f"{label}: `apply` gives a state of the wrong shape: {_one_line(error)}") from None
    expected = state.vector.shape[1]
    if vector.shape[0] not in (1, len(state.poses)) or vector.shape[1] != expected:
        raise CalibError(
            f"{label}: `apply` gives a state of shape {vector.shape}, expected ({len(state.poses)}, {expected})"
        )
    if not np.all(np.isfinite(vector)):
        raise CalibError(
            f"{label}: `apply` gives values that are not finite at {family_name(effect)} = {values.tolist()}"
        )
    return vector


def _line(error: Exception, path: Path) -> int | str:
    frames = [f for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) == path]
    return frames[-1].lineno or "?" if frames else "?"


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
