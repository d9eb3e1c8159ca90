"""What arms of a type share, as a file: `inspector pool` writes it, `inspector calibrate --type` begins from it."""

from __future__ import annotations

from pathlib import Path

import msgspec

from calib.dataset.files.atomic_write import write_text_atomically
from calib.errors import CalibError
from calib.extras.fleet.arm_type import ArmType
from calib.kinematics.robot import Robot
from calib.models.effect_fields import member_document, member_from
from calib.models.model_document import SavedMember
from calib.options import TypePrior
from calib.present.results import keys_of
from calib.strict_json import JsonFile, Size, SizeOrSign, Text, to_json

KIND, VERSION = "robot-calibration-inspector type", 1


class _SavedParameter(msgspec.Struct, frozen=True):
    """A parameter of the arms: mean of its correction, and its scatter from arm to arm."""

    name: Text
    mean: SizeOrSign
    sigma: Size


class _TypeDocument(msgspec.Struct, frozen=True):
    """Content of a type's file, apart from its format and version."""

    robot: Text
    arms: tuple[Text, ...]
    parameters: tuple[_SavedParameter, ...]
    effects: tuple[SavedMember, ...] = ()


def save_type(arm_type: ArmType, path: str | Path) -> None:
    """Write what arms of a type share, whole or not at all."""
    document = {
        "format": KIND,
        "version": VERSION,
        **keys_of(arm_type, "robot", "arms", "parameters"),
        "effects": [member_document(member) for member in arm_type.members],
    }
    write_text_atomically(Path(path), to_json(document))


def load_type(path: str | Path, robot: Robot) -> ArmType:
    """What arms of a type share, from a file of `save_type`.

    Args:
        path: of the file.
        robot: the nominal robot of an arm of the type, which its effects are of.

    Raises:
        CalibError: names the file and the place in it, what was found, and what is needed.
    """
    file = JsonFile(Path(path), "type file", "write it again with inspector pool", CalibError)
    document = file.checked([], file.read(KIND, VERSION), _TypeDocument)
    members = tuple(
        member_from(file, ["effects", i], msgspec.to_builtins(member), robot, ())
        for i, member in enumerate(document.effects)
    )
    prior = TypePrior(
        {parameter.name: parameter.mean for parameter in document.parameters},
        {parameter.name: parameter.sigma for parameter in document.parameters},
    )
    return ArmType(document.robot, document.arms, prior, members)
