"""Calibrated robot written as the user's own URDF or kinematics YAML with changed origins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.frames import invert, rotvec_from_rotation
from calib.kinematics.robot import Robot
from calib.plugins import load
from calib.robot_formats.chain.calibrated_origins import CalibratedChain, with_calibration
from calib.robot_formats.chain.serial_chain import RobotFileError, SerialChain
from calib.robot_formats.origin_yaml import OriginYaml, chain_of_yaml, read_origin_yaml, with_yaml_origins
from calib.robot_formats.robot_file import read_arm, source_links
from calib.robot_formats.robot_form import forms_of, template_suffixes
from calib.robot_formats.urdf.chain import chain_of_arm
from calib.robot_formats.urdf.text import TOOL_POINT_LINK, with_origins

_KEPT = "robot_source"  # stem of the user's own robot file in an imported dataset
_LOST_MM, _LOST_RAD = 1e-6, 1e-9


def template_name(path: Path) -> str:
    """Name under which a user's own robot file is kept in a dataset's folder."""
    return f"{_KEPT}{path.suffix.lower()}"


def kept_template(folder: Path | None, suffixes: Sequence[str] | None = None) -> Path | None:
    """The user's robot file that was kept in the dataset's folder at its import; None where there is none.

    `suffixes`: those that are looked for; None: of all files that can be written again with calibrated numbers.
    """
    wanted = template_suffixes() if suffixes is None else suffixes
    paths = [] if folder is None else [folder / f"{_KEPT}{suffix}" for suffix in wanted]
    return next((path for path in paths if path.is_file()), None)


@dataclass(frozen=True)
class CalibratedFile:
    """Text of a calibrated robot's file, with the changed joints and notes."""

    content: bytes
    changed: tuple[str, ...]  # joints with another origin
    notes: tuple[str, ...]

    @property
    def summary(self) -> str:
        """Changed joints and notes, a line each."""
        what = f"origins changed: {', '.join(self.changed)}" if self.changed else "no origin changed"
        return "\n".join([what, *(f"note: {note}" for note in self.notes)])

    def with_notes(self, notes: Sequence[str]) -> CalibratedFile:
        """This file with further notes."""
        return replace(self, notes=(*self.notes, *notes))


def in_template(template: Path, calibrated: Robot, nominal: Robot | None = None, comment: str = "") -> CalibratedFile:
    """The user's own file of this arm, in any form that has such templates, with the calibrated robot's numbers.

    `comment` is for forms that have a place for one; other arguments as of `calibrated_urdf`. Raises RobotFileError.
    """
    writer = next((form.in_template for form in forms_of(template) if form.in_template), "")
    if not writer:
        raise RobotFileError(f"{template}: is no template; expected {' or '.join(template_suffixes())}")
    return load(writer)(template, calibrated, nominal, comment)


def calibrated_urdf(
    template: Path,
    calibrated: Robot,
    nominal: Robot | None = None,
    comment: str = "",
) -> CalibratedFile:
    """Template URDF with the origins of the calibrated robot, every other byte unchanged.

    `nominal`: the robot before calibration, whose axes are those of the template; None: the template's own, for a robot
    made from it. Tip and base: from robot.toml, else the only ones in the template.
    Raises RobotFileError where the template is not of this arm.
    """
    tip, base = source_links(calibrated)
    arm = read_arm(template, tip=tip, base=base)
    chain = chain_of_arm(arm)
    found = with_calibration(chain, nominal, calibrated)
    text = with_origins(arm, found.chain, comment)
    notes = []
    if not found.tip_known:
        notes.append(
            f"[tool] of robot.toml does not end at link {arm.tip}, so how that sits on the last joint stays as it was"
        )
    elif not text.tip_written:
        notes.append(f"no fixed joint holds link {arm.tip}, so its place on the last joint stays as it was")
    if found.chain.tool_point_mm is not None:
        notes.append(f"link {TOOL_POINT_LINK} on {arm.tip} is the measured point, {_place(found.chain)} from it")
    return CalibratedFile(text.content, text.changed, tuple(notes))


def calibrated_yaml(
    template: Path, calibrated: Robot, nominal: Robot | None = None, comment: str = ""
) -> CalibratedFile:
    """A maker's kinematics file with calibrated numbers, all else unchanged, so that it gets no comment.

    Arguments as of `calibrated_urdf`.
    """
    origins = read_origin_yaml(template)
    chain = chain_of_yaml(origins)
    holds_tip = origins.flange is not None
    found = with_calibration(chain, nominal, calibrated, holds_tip=holds_tip)
    text, changed = with_yaml_origins(origins, found.chain)
    return CalibratedFile(text.encode(), changed, _not_in_yaml(origins, chain, found))


def _not_in_yaml(origins: OriginYaml, chain: SerialChain, found: CalibratedChain) -> tuple[str, ...]:
    """Notes on what a kinematics file cannot hold: tool, measured point, or the place of the flange."""
    notes = []
    if found.chain.tool_point_mm is not None:
        place = ", ".join(f"{value:.4g}" for value in found.chain.tool_point_mm)
        notes.append(f"the measured point is no part of a kinematics file: it is {place} mm from its last frame")
    if not found.tip_known:
        return ("the tool is no part of a kinematics file", *notes)
    if origins.flange is not None:
        return tuple(notes)
    lost = invert(chain.last_T_tip) @ found.chain.last_T_tip
    off_mm = float(np.linalg.norm(lost[:3, 3]))
    turned_rad = float(np.linalg.norm(rotvec_from_rotation(lost[:3, :3])))
    if off_mm >= _LOST_MM or turned_rad >= _LOST_RAD:
        notes.append(
            f"the calibrated flange is {off_mm:.3g} mm and {np.degrees(turned_rad):.3g} deg off its nominal place on "
            "the last joint's axis, for which a kinematics file has no number: it is lost"
        )
    return tuple(notes)


def _place(chain: SerialChain) -> str:
    """Tool point of a chain as text: "50.1, -29.5, 119.8 mm"."""
    assert chain.tool_point_mm is not None
    return f"{', '.join(f'{value:.4g}' for value in chain.tool_point_mm)} mm"
