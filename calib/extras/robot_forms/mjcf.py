"""MuJoCo's models (MJCF), compiled by MuJoCo itself (the extra `mujoco`) and read as a serial chain.

A model may name other files and ask for any number of parts. So it is looked through before MuJoCo sees it: every mesh
that it names lies in its folder or below, and other models and what a serial arm does not need are refused. MuJoCo then
compiles it in a process of its own with bounded memory and time (`mjcf_compiled`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.bounded_process import ProcessFailed, ProcessLimits, ask
from calib.robot_formats.chain.serial_chain import ChainJoint, RobotFileError, SerialChain
from calib.robot_formats.robot_file import ReadOptions, RobotFile, of_chain, read_xml
from calib.robot_formats.urdf.safe_xml import XmlFile

_LIMITS = ProcessLimits(seconds=60.0, memory_bytes=2 * 1024**3)
_MOST_PARTS = 10_000  # elements of a model; a whole humanoid has some thousands
_REFUSED = {  # code, other models, or any number of parts and any size of memory
    "include": "give the file that it includes, or put its text there",
    **dict.fromkeys(
        ("plugin", "extension", "replicate", "composite", "flexcomp", "size", "attach", "model"),
        "a serial arm needs none; leave it out",
    ),
}
_NAMES = ("file", "meshdir", "assetdir", "texturedir")  # beginnings of attributes that name files: of textures, fileup


def read_mjcf(path: Path, reading: ReadOptions) -> RobotFile:
    """Robot from a base body (None: the world) to a tip, a body or a site (None: the only end body) of a model.

    Raises RobotFileError in one line: MuJoCo is not installed or refuses the model, several tips, no serial arm.
    """
    require_own_folder(read_xml(path))
    request = {"model": str(path.absolute()), "tip": reading.tip, "base": reading.base}
    try:
        told = ask("calib.extras.robot_forms.mjcf_compiled:answer", request, _LIMITS)
    except ProcessFailed as error:
        raise RobotFileError(f"{path}: MuJoCo cannot read it: it {error}; give the arm alone, or its URDF") from None
    if "error" in told:
        raise RobotFileError(f"{path}: {told['error']}")
    joints = tuple(
        ChainJoint(
            **{**joint, "before_T_joint": np.array(joint["before_T_joint"])}
            | {key: tuple(joint[key]) for key in ("axis", "com_mm")}
        )
        for joint in told["joints"]
    )
    chain = {**told, "joints": joints, "last_T_tip": np.array(told["last_T_tip"])}
    return of_chain(SerialChain(path.stem, **chain | {"gravity_m_s2": tuple(told["gravity_m_s2"])}), path)


def require_own_folder(file: XmlFile) -> None:
    """Raise RobotFileError where a model has refused parts or names a file that is not in its folder or below."""
    folder = file.path.absolute().parent
    for number, element in enumerate(file.root.with_all_below()):
        if number > _MOST_PARTS:
            file.fail(element, f"found more than {_MOST_PARTS} elements", "give the arm alone")
        if element.tag in _REFUSED:
            file.fail(element, f"found <{element.tag}>", _REFUSED[element.tag])
        for key, name in element.attributes.items():
            inside = (folder / name).resolve().is_relative_to(folder.resolve()) and ".." not in Path(name).parts
            if key.startswith(_NAMES) and not inside:
                file.fail(element, f"names {name[:60]!r}, which is not below its folder", "put it there")
