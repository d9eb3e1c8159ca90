"""Checks around a user's own effect: a failure in its code becomes a CalibError of one line with the place."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Mapping
from typing import Any

import numpy as np

from calib.dataset.input_names import CONDITIONS
from calib.effects.state import RobotState
from calib.errors import CalibError


def is_user_defined(effect: object) -> bool:
    """Whether an effect's class is defined outside this package, by a user."""
    return type(effect).__module__.partition(".")[0] != "calib"


def checked_apply(effect: Any, state: RobotState, values: Mapping[str, float]) -> RobotState:
    """Robot state after a user's effect (`effect.apply(state, **values)`), checked.

    Raises:
        CalibError: `apply` raises, returns no state or one of the wrong shape, gives values that are not finite, or
            changes its argument, which fits share (its poses are the dataset's).
    """
    label = f"effect {type(effect).__name__}"
    before = [array.copy() for array in _arrays_of(state)]
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
    if not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(before, _arrays_of(state), strict=True)):
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
    """Text of `effect.meaning(parameter, value, state)`. Raises CalibError where it fails or gives no text."""
    label = f"effect {type(effect).__name__}"
    try:
        text = effect.meaning(parameter, value, state)
    except BaseException as error:
        if is_interrupt(error):
            raise
        raise CalibError(f"{label}: `meaning` fails with {error_words(error)}") from error
    if not isinstance(text, str):
        raise CalibError(f"{label}: `meaning` returns {type(text).__name__}; return text")
    return text


def is_interrupt(error: BaseException) -> bool:
    """Whether an error is a user's interrupt (Ctrl-C), which Python raises on the main thread alone."""
    return isinstance(error, KeyboardInterrupt) and threading.current_thread() is threading.main_thread()


def error_words(error: BaseException) -> str:
    """Type and message of an error in one line: "KeyError: 'humidity'"."""
    return f"{type(error).__name__}: {one_line(error)}".removesuffix(": ")


def one_line(error: BaseException) -> str:
    """Message of an error in one line."""
    return " ".join(str(error).split())


def _arrays_of(state: RobotState) -> tuple[np.ndarray, ...]:
    """Arrays of a state and its poses, which `apply` must not write to."""
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
        poses.sequence.q,
    )
    return (*arrays, *(array for array in optional if array is not None))


def _at(effect: Any, error: BaseException) -> str:
    """Line of the user's file in which an error arose, as " in line 12"; "" where the error arose elsewhere."""
    code = getattr(effect.apply, "__code__", None)
    frames = traceback.extract_tb(error.__traceback__)
    lines = [f.lineno for f in frames if code is not None and f.filename == code.co_filename]
    return f" in line {lines[-1]}" if lines else ""
