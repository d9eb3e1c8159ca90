"""Checks around a user's own effect: what goes wrong in its code becomes an error of one line that says where."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Mapping
from typing import Any

import numpy as np

from calib.dataset.input_names import CONDITIONS
from calib.effects.state import RobotState
from calib.errors import CalibError


def is_users(effect: object) -> bool:
    """Whether an effect's class is from outside this package, a user's own."""
    return type(effect).__module__.partition(".")[0] != "calib"


def checked_apply(effect: Any, state: RobotState, values: Mapping[str, float]) -> RobotState:
    """`effect.apply(state, **values)`, checked.

    Raises:
        CalibError: it raises, returns no state or one of the wrong shape, gives values that are not finite, or changes
            the state that it was handed, which fits share (its poses are the dataset's).
    """
    label = f"effect {type(effect).__name__}"
    before = [array.copy() for array in _handed(state)]
    expected = state.vector.shape[1]  # before it can be changed
    try:
        with np.errstate(all="ignore"):  # what is not finite is an error of its own, below
            after = effect.apply(state, **values)
    except CalibError:
        raise
    except BaseException as error:  # one that calls exit() must not end the server
        if is_interrupt(error):
            raise
        raise CalibError(f"{label}: `apply` fails{_at(effect, error)} with {error_words(error)}") from error
    if not isinstance(after, RobotState):
        raise CalibError(
            f"{label}: `apply` returns {type(after).__name__}; return the state that `state.add_...` gives"
        )
    if not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(before, _handed(state), strict=True)):
        raise CalibError(
            f"{label}: `apply` changes what it was handed; leave arrays as they are (a copy may be changed) and return "
            "the state that `state.add_...` gives"
        )
    try:
        vector = after.vector
    except ValueError as error:
        raise CalibError(f"{label}: `apply` gives a state of the wrong shape: {one_line(error)}") from error
    if vector.shape[0] not in (1, len(state.poses)) or vector.shape[1] != expected:
        raise CalibError(
            f"{label}: `apply` gives a state of shape {vector.shape}, expected ({len(state.poses)}, {expected}): "
            "one value for all poses, or one a pose"
        )
    if not np.all(np.isfinite(vector)):
        at = ", ".join(f"{name} = {value:.3g}" for name, value in values.items())
        raise CalibError(f"{label}: `apply` gives values that are not finite at {at}")
    return after


def checked_meaning(effect: Any, parameter: object, value: float, state: RobotState) -> str:
    """`effect.meaning(parameter, value, state)`. Raises CalibError where it fails or gives no text."""
    label = f"effect {type(effect).__name__}"
    try:
        words = effect.meaning(parameter, value, state)
    except BaseException as error:
        if is_interrupt(error):
            raise
        raise CalibError(f"{label}: `meaning` fails with {error_words(error)}") from error
    if not isinstance(words, str):
        raise CalibError(f"{label}: `meaning` returns {type(words).__name__}; return text")
    return words


def is_interrupt(error: BaseException) -> bool:
    """Whether an error is that of a user who stops the program: Python raises it on the main thread alone."""
    return isinstance(error, KeyboardInterrupt) and threading.current_thread() is threading.main_thread()


def error_words(error: BaseException) -> str:
    """ "KeyError: 'humidity'": what an error is, in one line."""
    return f"{type(error).__name__}: {one_line(error)}".removesuffix(": ")


def one_line(error: BaseException) -> str:
    """An error's message in one line."""
    return " ".join(str(error).split())


def _handed(state: RobotState) -> tuple[np.ndarray, ...]:
    """The arrays that `apply` is given and must not write to."""
    poses = state.poses
    optional = (*(getattr(poses, name) for name in CONDITIONS), poses.approach)
    offsets = state.target_offsets_mm.values()
    arrays = (
        state.table,
        state.base_rotvec_rad,
        state.displacement_mm,
        *offsets,
        poses.q,
        poses.order,
        poses.came_from,
    )
    return (*arrays, *(array for array in optional if array is not None))


def _at(effect: Any, error: BaseException) -> str:
    """ " in line 12" of the file that defines the effect; "" where the error has no line there."""
    code = getattr(effect.apply, "__code__", None)
    frames = traceback.extract_tb(error.__traceback__)
    lines = [f.lineno for f in frames if code is not None and f.filename == code.co_filename]
    return f" in line {lines[-1]}" if lines else ""
