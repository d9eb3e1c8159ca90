"""Conversion of effects to plain data (name of the effect and its fields) and back, for files.

A class whose fields are numbers, texts, arrays, tuples, mappings and dataclasses of these is saved and read once it is
in `MEMBER_KINDS`. A user's effect, whose code no file holds, is looked up in the effects file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from calib.effects.catalogue import MEMBER_KINDS as CATALOGUE_MEMBERS
from calib.effects.checked_apply import is_user_defined
from calib.effects.effect import Effect, Family, family_name
from calib.effects.link_errors import LinkErrors, TargetOffsets
from calib.effects.place_errors import PlaceErrors
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.screening.curves.smooth_joint_error import SmoothJointError
from calib.strict_json import JsonFile, Place

MEMBER_KINDS: tuple[tuple[str, type], ...] = (
    (LinkErrors.name, LinkErrors),
    (TargetOffsets.name, TargetOffsets),
    (PlaceErrors.name, PlaceErrors),
    *((kind.name, kind) for kind in CATALOGUE_MEMBERS),
    (SmoothJointError.name, SmoothJointError),
)
"""Families and the classes of their members; where a family has several, the fields decide."""
_LARGEST_INT = 10_000  # bound of a joint's number, a harmonic, a count of frames
_SIGNED = ("sign", "place_deg", "start")  # whole numbers that may be below 0
_ROBOT = "robot"  # field with the model's robot, which is in the file already


def member_document(effect: Effect) -> dict[str, Any]:
    """Name and fields of an effect for a file. Raises CalibError for a user's effect with unsuitable fields."""
    if not is_user_defined(effect) and type(effect) not in [kind for _, kind in MEMBER_KINDS]:
        raise CalibError(f"effect {family_name(effect)} cannot be saved in a model file")
    try:
        value: object = effect  # a user's effect may be any class with the methods, a dataclass or not
        values: dict[str, Any] = _plain(value) if is_dataclass(value) else {}
    except (TypeError, RecursionError) as error:
        raise CalibError(
            f"effect {family_name(effect)} cannot be saved: {' '.join(str(error).split())}; its fields have to be "
            "numbers, texts, or lists of them"
        ) from None
    values.pop(_ROBOT, None)
    return dict(json.loads(json.dumps({"family": family_name(effect), "fields": values})))


def _plain(value: Any) -> Any:
    """A field's value as plain numbers, texts, lists and mappings; dataclasses become mappings without defaults."""
    if isinstance(value, Robot):  # it is in the file already
        return None
    if is_dataclass(value) and not isinstance(value, type):
        own = {f.name: (getattr(value, f.name), f.default) for f in fields(value)}
        return {
            name: _plain(of)
            for name, (of, default) in own.items()
            if not (isinstance(of, int | float | str) and of == default)
        }
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        raise TypeError(f"found {value}")
    if value is None or isinstance(value, int | float | str):
        return value
    raise TypeError(f"found a {type(value).__name__}")


def member_from(
    file: JsonFile, place: Place, document: Mapping[str, Any], robot: Robot, user_effects: Sequence[Family] = ()
) -> Effect:
    """Effect rebuilt from a file's name and fields, for this robot. Raises the file's error where this fails."""
    family, saved = document["family"], document["fields"]
    kinds = [kind for name, kind in MEMBER_KINDS if name == family]
    if not kinds:
        return _users(file, place, document, user_effects)
    kind = next((kind for kind in kinds if set(saved) == _own_fields(kind)), kinds[0])
    member: Effect = _built(file, [*place, "fields"], saved, kind, robot)
    for name in (field.name for field in fields(kind)):
        value = getattr(member, name)
        most = robot.n_joints - 1 if name in ("joint", "other") else _LARGEST_INT
        least = -most if name in _SIGNED else 0
        if isinstance(value, int) and not least <= value <= most:
            needed = f"a whole number from {least} to {most} is needed"
            file.fail([*place, "fields", name], str(value)[:20], needed)
    return member


def _own_fields(kind: type) -> set[str]:
    """Names of the fields without a default, which every effect of a class has."""
    return {f.name for f in fields(kind) if f.default is MISSING and f.name != _ROBOT}


def _built(file: JsonFile, place: Place, saved: Any, kind: type, robot: Robot) -> Any:
    """Dataclass of a given class, made from saved fields, each checked."""
    saved = file.checked(place, saved, dict[str, Any])
    hints = get_type_hints(kind)
    known = {field.name: field for field in fields(kind)}
    unknown = sorted(set(saved) - set(known))
    if unknown:
        file.fail(place, repr(unknown[0]), f"its fields are {', '.join(known)}")
    values = {}
    for name, field in known.items():
        if name == _ROBOT:
            values[name] = robot
        elif name in saved or (field.default is MISSING and field.default_factory is MISSING):
            values[name] = _field(file, [*place, name], saved.get(name), hints[name], robot)
    return kind(**values)


def _field(file: JsonFile, place: Place, value: Any, hint: Any, robot: Robot) -> Any:
    """Value of a dataclass field, made from its saved form."""
    choices = [kind for kind in (hint, *get_args(hint)) if isinstance(kind, type) and is_dataclass(kind)]
    for kind in choices:
        if isinstance(value, dict) and set(value) <= {field.name for field in fields(kind)}:
            return _built(file, place, value, kind, robot)
    if choices and get_origin(hint) is not tuple:
        file.fail(place, "no fields that fit", f"those of {' or '.join(kind.__name__ for kind in choices)}")
    return file.checked(place, value, hint, _decoded)


def _users(file: JsonFile, place: Place, document: Mapping[str, Any], user_effects: Sequence[Family]) -> Effect:
    """Effect among the user's own ones that a file's entry describes."""
    family = document["family"]
    members = [member for one in user_effects if one.name == family for member in one.members]
    for member in members:
        if member_document(member) == document:
            return member
    found = f"{family!r} with other fields than the effects file gives it" if members else repr(family)
    file.fail([*place, "family"], found, "no effect of this program; give its file (--effects-file)")


def _decoded(kind: type, value: Any) -> Any:
    """Array of finite numbers, read from a saved field."""
    if (get_origin(kind) or kind) is np.ndarray:
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise ValueError("an array of numbers is needed") from None
        if not np.isfinite(array).all():
            raise ValueError("an array of finite numbers is needed")
        (number,) = get_args(get_args(kind)[1])
        return array.astype(number)
    raise NotImplementedError(f"fields of the type {kind}")
