"""Effects from a user's own file, checked before they are used.

The file is Python. Either it has `EFFECTS`, a tuple of effects, or every class in it that has `parameters` and `apply`
is taken: a dataclass with a field `joint` once for each joint, one without fields once.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.effects.catalogue import catalogue_names
from calib.effects.checked_apply import error_words, is_interrupt
from calib.effects.effect import (
    Effect,
    Family,
    NaturalBound,
    Parameter,
    apply_values,
    families_from,
    has_meaning,
    meaning_of,
    state_derivative,
)
from calib.effects.state import RobotState
from calib.errors import CalibError, is_one_line
from calib.strict_json import MOST_SIZE

_UNSEEN = 1e-2  # share of what a parameter changes beside others, below which its derivative at zero is none


def load_effects(path: Path, state: RobotState) -> tuple[Family, ...]:
    """Effect families of a user's effects file, tested on a robot state. Raises CalibError in one line.

    `calib.fitting.observations.nominal_state` makes the state of a dataset.
    """
    module = _load(path)
    effects = _effects(path, module, state.robot.n_joints)
    if not effects:
        raise CalibError(f"{path}: found no effect; define a class with `parameters` and `apply`, or a tuple EFFECTS")
    return check_effects(effects, state, str(path))


def check_effects(effects: Iterable[Effect], state: RobotState, where: str = "effects") -> tuple[Family, ...]:
    """Effect families of a user's effects, after a trial on a robot state. Raises CalibError in one line.

    A family's `note` says which of its parameters have no derivative at zero, where the ranking looks.
    """
    effects = tuple(effects)
    for effect in effects:
        _check(effect, state, where)
    families = tuple(_with_note(family, state) for family in families_from(effects))
    for family in families:
        if not is_one_line(family.name):
            raise CalibError(
                f"{where}: effect {family.name!r:.200}: its name is no line without control characters; give it another"
            )
        if family.name in catalogue_names():
            raise CalibError(
                f"{where}: effect {family.name!r} has the name of one in the catalogue; give it another `name`"
            )
    return families


def _load(path: Path) -> ModuleType:
    """Module imported from an effects file. Raises CalibError with the line where it cannot be imported."""
    if not path.is_file():
        raise CalibError(f"{path}: no such effects file")
    spec = importlib.util.spec_from_file_location(f"_effects_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise CalibError(f"{path}: not a Python file; an effects file ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    try:
        # Not by the loader: a file that was saved twice within a second would come out of its cache as it was before.
        code = compile(path.read_bytes(), str(path), "exec")
        with _siblings(path.resolve().parent):
            exec(code, module.__dict__)
    except SyntaxError as error:
        where = f"line {error.lineno}: " if error.lineno else ""
        raise CalibError(f"{path}: {where}{error.msg}; mend the syntax") from None
    except BaseException as error:  # a file that calls exit() must not end the server
        if is_interrupt(error):
            raise
        raise CalibError(f"{path}: line {_line(error, path)}: {error_words(error)}") from None
    return module


@contextmanager
def _siblings(folder: Path) -> Iterator[None]:
    """Context in which an effects file may import neighbouring files, which are read anew on each load."""
    before, wrote = set(sys.modules), sys.dont_write_bytecode
    sys.path.append(str(folder))  # last: a neighbour of any name hides nothing that is installed
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        sys.dont_write_bytecode = wrote
        sys.path.remove(str(folder))
        for name in set(sys.modules) - before:
            if folder in Path(getattr(sys.modules[name], "__file__", None) or "/").parents:
                del sys.modules[name]


def _effects(path: Path, module: ModuleType, joints: int) -> tuple[Effect, ...]:
    """Effects of a user's module: the entries of its tuple EFFECTS, else instances of its effect classes."""
    if not hasattr(module, "EFFECTS"):
        return tuple(_instances(path, module, joints))
    effects = module.EFFECTS
    if not isinstance(effects, tuple | list):
        raise CalibError(
            f"{path}: EFFECTS is a {type(effects).__name__}; make it a tuple of effects, (MyEffect(joint=1),)"
        )
    for effect in effects:
        if isinstance(effect, type):
            raise CalibError(
                f"{path}: EFFECTS holds the class {effect.__name__}; put effects in, such as {effect.__name__}(...)"
            )
    return tuple(effects)


def _instances(path: Path, module: ModuleType, joints: int) -> Iterable[Effect]:
    """Instances of a module's effect classes: one per joint for a class with the field `joint`, else one."""
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
        if needed not in ([], ["joint"]):
            raise CalibError(
                f"{path}: {value.__name__} needs {', '.join(needed)}; only `joint` is filled in, use EFFECTS for more"
            )
        try:
            yield from (value(joint=j) for j in range(joints)) if needed else (value(),)
        except BaseException as error:
            if is_interrupt(error):
                raise
            raise CalibError(
                f"{path}: {value.__name__} cannot be made, {error_words(error)}; a dataclass with the field `joint` or "
                "without fields is, others go into EFFECTS"
            ) from None


def _is_sound(name: object, unit: object, doc: object, scale: object) -> bool:
    """Whether the fields of a parameter from a user's file are of their declared types."""
    return (
        isinstance(name, str)
        and name.isidentifier()
        and isinstance(unit, str)
        and isinstance(doc, str)
        and isinstance(scale, int | float)
        and 0.0 < scale <= MOST_SIZE
    )


def _check(effect: Any, state: RobotState, where: str) -> None:
    """Raise CalibError where a user's effect has unsound parameters or bounds, fails, or is not zero at zero values."""
    label = f"{where}: effect {type(effect).__name__}"
    parameters = getattr(effect, "parameters", None)
    if not isinstance(parameters, tuple | list) or not parameters:
        raise CalibError(f"{label}: `parameters` is {parameters!r}; a tuple of Parameter is needed")
    for p in parameters:
        if not isinstance(p, Parameter) or not _is_sound(p.name, p.unit, p.doc, p.scale):
            raise CalibError(
                f"{label}: {p!r} is no Parameter with an identifier for a name, text for unit and doc, a scale above 0 "
                f"and of {MOST_SIZE:g} at most"
            )
    if len({p.name for p in parameters}) < len(parameters):
        raise CalibError(f"{label}: two parameters have the same name")
    bounds = getattr(effect, "bounds", ())
    if not isinstance(bounds, tuple | list) or not all(isinstance(bound, NaturalBound) for bound in bounds):
        raise CalibError(f"{label}: `bounds` is {bounds!r:.200}; a tuple of NaturalBound is needed")
    zero = np.zeros(len(parameters))
    after = _applied(effect, state, zero, where)
    if not np.array_equal(np.broadcast_to(state.vector, after.shape), after):
        raise CalibError(f"{label}: with all parameters zero it still changes the state; zero has to mean absent")
    for k, p in enumerate(parameters):
        one = zero.copy()
        one[k] = p.scale
        _applied(effect, state, one, where)
        if has_meaning(effect):
            with _errors_from(where):
                meaning_of(effect, p, p.scale, state)


def _with_note(family: Family, state: RobotState) -> Family:
    """A user's family, with a note on parameters that the ranking cannot see, if there are any."""
    unseen = list(dict.fromkeys(name for member in family.members for name in _unseen(member, state)))
    if not unseen:
        return family
    several = len(unseen) > 1
    note = (
        f"{' and '.join(unseen)} {'change' if several else 'changes'} nothing to first order while all parameters are "
        f"zero, so that the ranking does not see {'them' if several else 'it'} and a fit does not find "
        f"{'them' if several else 'it'}; use parameters that act on their own, such as the amplitudes of a sine and a "
        "cosine in place of amplitude and phase"
    )
    return replace(family, note=note)


def _unseen(effect: Effect, state: RobotState) -> Iterator[str]:
    """Names of a user's parameters whose derivative at zero is none, though they change something elsewhere."""
    scales = np.array([p.scale for p in effect.parameters])
    each = np.diag(scales)
    try:
        derivatives = list(state_derivative(effect, state, np.zeros(len(scales))))
        everywhere = apply_values(effect, state, scales).vector
        without = [apply_values(effect, state, scales - one).vector for one in each]
    except CalibError:  # a mistake away from zero is told where a fit comes to it
        return
    for parameter, derivative, others in zip(effect.parameters, derivatives, without, strict=True):
        changed = np.abs(everywhere - others).max()
        if changed > 0.0 and np.abs(derivative).max() * parameter.scale < _UNSEEN * changed:
            yield parameter.name


def _applied(effect: Effect, state: RobotState, values: Array, where: str) -> Array:
    """State vector (1 or N, S) after applying a user's effect; an error names the effects file."""
    with _errors_from(where):
        return apply_values(effect, state, values).vector


@contextmanager
def _errors_from(where: str) -> Iterator[None]:
    """Context that puts the name of the user's file before the message of a CalibError."""
    try:
        yield
    except CalibError as error:
        raise CalibError(f"{where}: {error}") from None


def _line(error: BaseException, path: Path) -> int | str:
    """Number of the innermost line of a file in which an error was raised; "?" where it came from elsewhere."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) == path]
    return frames[-1].lineno or "?" if frames else "?"
