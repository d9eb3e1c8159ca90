"""Correction of the targets in a robot program: joints, and poses in the maker's own numbers.

A controller turns a pose into joints by its own nominal table. So a pose target becomes the nominal arm's joints there
(`calib.extras.robot_programs.postures`), these are corrected as any joint target, and the new pose is where the nominal
arm stands with the corrected joints, in the target's work frame and for its tool. The controller's flange is that of
robot.toml (`calib.kinematics.flange`), its base that of robot.toml.

A fit that determines positions alone knows them for the tool point of robot.toml: pose targets for another tool point
are then left as they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.compensation.correction import Correction, Corrects
from calib.compensation.target_correction import correction_of
from calib.errors import CalibError
from calib.extras.robot_programs.postures import Place, along, postures_at, same_posture
from calib.extras.robot_programs.program_targets import Program, frame_of, require_frames
from calib.extras.robot_programs.program_text.pose_numbers import pose_transform, pose_values
from calib.extras.robot_programs.program_text.targets import NO_CONFIGURATION, ProgramTarget
from calib.kinematics.flange import flange_frames, flange_T_tip, measured_point_on_flange
from calib.kinematics.robot import FixedFrame, Robot
from calib.rendering import numbers
from calib.robot_formats.robot_file import source_links

SAME_POINT_MM = 0.5
"""Distance within which a program's tool point is that of robot.toml."""
_SAME_PLACE = 1e-6  # mm or rad
BY_CONFIGURATION, BY_NEAR = "configuration", "qnear"
_NOT_TOLD = "its posture is not told: no target whose joints are known stands before it on every way there"
_SINGULAR = "its posture is not told: the way to it passes a singular posture"


@dataclass(frozen=True)
class TargetMove:
    """What became of one target of a program."""

    target: ProgramTarget
    row: int | None  # in the correction; None where the target's joints are not known
    reached: bool  # otherwise the program keeps its numbers
    moved_mm: float = np.nan  # of the commanded tool point; nan where not reached
    moved_deg: float = np.nan  # of the commanded tool
    uncorrected_mm: float = np.nan  # error of the calibrated arm without correction; nan where unknown
    reason: str = ""  # why it is not reached
    posture: str = ""  # what told the posture of a pose: the configuration, qnear, the name of the target before it


@dataclass(frozen=True)
class ProgramCorrection:
    """Corrected program: its content, what became of each target, and the correction of the joints."""

    program: Program
    content: bytes
    targets: tuple[TargetMove, ...]
    correction: Correction  # of the targets whose joints are known, in their order
    notes: tuple[str, ...] = ()

    @property
    def reached(self) -> bool:
        """Whether every target is reached."""
        return all(target.reached for target in self.targets)

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the correction's rows."""
        return tuple(move.target.name for move in self.targets if move.row is not None)


@dataclass(frozen=True)
class _Known:
    """A target with its nominal joints, or the reason why they are not known."""

    target: ProgramTarget
    q: Array | None
    flange_T_tool: Array
    base_T_work: Array
    reason: str = ""
    posture: str = ""
    goal: Array | None = None  # (4, 4) base_T_flange of a pose


def require_no_conditions(program: Program, needed: Sequence[str], families: Sequence[str]) -> None:
    """Raise CalibError where the calibrated arm depends on conditions, which a program does not tell.

    Args:
        program: the program as it was read.
        needed: columns that `calib.compensation.target_correction.needed_columns` returns.
        families: names of the model's effects.
    """
    if needed:
        raise CalibError(
            f"{program.path}: the calibrated arm depends on {', '.join(needed)} through its effects "
            f"({', '.join(families)}), which a program does not tell; correct its targets as a table (--joints)"
        )


def corrected_program(
    program: Program,
    nominal: Robot,
    calibrated: Corrects | Robot,
    *,
    kind: str | None = None,
    tool: Array | None = None,
    work: Array | None = None,
) -> ProgramCorrection:
    """Program with corrected targets, and what became of each.

    Args:
        program: the program as it was read.
        nominal: robot that the controller computes with.
        calibrated: a calibration, a diagnosis, a model from a file, a robot.
        kind: "pose", "position", or None for what the fit determines.
        tool: (4, 4) flange_T_tool, mm, of targets whose tool the program does not define.
        work: (4, 4) base_T_work, mm, of targets whose work frame it does not define.

    Raises:
        CalibError: a frame that is neither defined nor given.
    """
    require_frames(program, tool, work)
    known = _with_joints(program, nominal, tool, work)
    told = [each for each in known if each.q is not None]
    q0 = np.array([each.q for each in told]).reshape(-1, nominal.n_joints)
    correction = correction_of(nominal, calibrated, q0, kind=kind, ids=[each.target.name for each in told])
    correction = _where_the_tool_is_known(correction, told)
    before, after = (flange_frames(nominal, q) for q in (correction.q_nominal, correction.q))
    commanded = nominal.commands_of(correction.q)
    moves: list[TargetMove] = []
    values: dict[int, Array] = {}
    row = -1
    for k, each in enumerate(known):
        if each.q is None:
            moves.append(TargetMove(each.target, None, False, reason=each.reason))
            continue
        row += 1
        reached = bool(correction.reached[row])
        base_T_tool = after[row] @ each.flange_T_tool
        moved = frames.invert(before[row] @ each.flange_T_tool) @ base_T_tool
        turn = frames.rotvec_from_rotation(moved[:3, :3])
        move = TargetMove(
            each.target,
            row,
            reached,
            float(np.linalg.norm(moved[:3, 3])) if reached else np.nan,
            float(np.degrees(np.linalg.norm(turn))) if reached else np.nan,
            float(correction.uncorrected_mm[row]),
            correction.reasons[row],
            each.posture,
        )
        moves.append(move)
        if reached and each.target.kind == "joints":
            values[k] = commanded[row] if program.language == "URScript" else np.degrees(commanded[row])
        elif reached:
            work_T_tool = frames.invert(each.base_T_work) @ base_T_tool
            values[k] = pose_values(program.language, work_T_tool, each.target.values)
    notes = (*program.notes, *_flange_note(nominal))
    return ProgramCorrection(program, program.with_values(values), tuple(moves), correction, notes)


def _flange_note(nominal: Robot) -> Iterable[str]:
    """Note on a robot.toml that was made of a file with links before these had their flange written."""
    tip, _ = source_links(nominal)
    if tip and nominal.flange == FixedFrame() and not np.allclose(flange_T_tip(nominal), np.eye(4), atol=_SAME_PLACE):
        yield (
            f"robot.toml has no [flange], so the last joint's frame is taken for it; if it is {tip}, import the arm's "
            "file anew, or add it"
        )


def _with_joints(program: Program, nominal: Robot, tool: Array | None, work: Array | None) -> list[_Known]:
    """Each target with its joints: as written, or of the nominal arm at its pose, in the program's posture."""
    known: dict[int, _Known] = {}
    poses: dict[int, _Known] = {}
    for target in program.targets:
        each = _Known(target, None, frame_of(target.tool, tool), frame_of(target.work, work))
        if target.kind == "joints":
            q = _written(program, nominal, target.values)
            known[target.place] = replace(each, q=q, flange_T_tool=flange_T_tip(nominal))
            continue
        try:
            base_T_tool = each.base_T_work @ pose_transform(program.language, target.values)
        except ValueError as error:
            known[target.place] = replace(each, reason=str(error))
            continue
        poses[target.place] = replace(each, goal=base_T_tool @ frames.invert(each.flange_T_tool))
    alone = {
        place: Place(
            pose.goal,
            pose.target.configuration,
            _written(program, nominal, np.array(pose.target.near)) if pose.target.near else None,
        )
        for place, pose in poses.items()
        if pose.goal is not None
        if pose.target.near or (pose.target.configuration != NO_CONFIGURATION and not pose.target.keeps_posture)
    }
    for (place, asked), posture in zip(alone.items(), postures_at(nominal, list(alone.values())), strict=True):
        if not posture.several:
            by = BY_CONFIGURATION if asked.near is None else BY_NEAR
            known[place] = replace(poses.pop(place), q=posture.q, reason=posture.reason, posture=by)
    known |= _Ways(nominal, known, poses).followed()
    return [known[target.place] for target in program.targets]


def _written(program: Program, nominal: Robot, values: Array) -> Array:
    """Joints (n,), rad, of values in the program's own units."""
    return nominal.joints_of(values if program.language == "URScript" else np.radians(values))


class _Ways:
    """Postures of poses that follow from those before them: kept on a linear motion, the nearest after another one."""

    def __init__(self, nominal: Robot, known: Mapping[int, _Known], poses: Mapping[int, _Known]) -> None:
        self._nominal, self._known, self._poses = nominal, known, poses
        self._ends: dict[tuple[bytes, int, bool], Array | None] = {}

    def followed(self) -> dict[int, _Known]:
        """The poses with their joints, or with the reason why these are not told."""
        open_: dict[int, str] = {}
        while True:
            found = self._spread(open_)
            reached = found.keys() & self._poses.keys()
            doubts = {place: doubt for place in reached if (doubt := self._doubt(place, found))}
            if not doubts:
                break
            open_ |= doubts
        for place in self._poses.keys() - found.keys():
            singular = any(start is not None and start.q is not None for start, _ in self._ways(place, found))
            reason = open_.get(place, _SINGULAR if singular else _NOT_TOLD)
            open_[place] = reason
        return found | {place: replace(self._poses[place], reason=reason) for place, reason in open_.items()}

    def _spread(self, open_: Mapping[int, str]) -> dict[int, _Known]:
        """What is known, and the poses that can be reached from there, each by its first way."""
        found = dict(self._known)
        waiting = [place for place in self._poses if place not in open_]
        count = -1
        while len(found) > count:
            count = len(found)
            for place in [each for each in waiting if each not in found]:
                for start, q in self._ways(place, found):
                    if q is not None:
                        told = BY_CONFIGURATION if start is None or start.q is None else start.target.name
                        found[place] = replace(self._poses[place], q=q, posture=told)
                        break
        return found

    def _doubt(self, place: int, found: Mapping[int, _Known]) -> str:
        """Why the joints that were found of a pose may be others; "" where all ways lead to them."""
        for start, q in self._ways(place, found):
            if q is None:
                return _NOT_TOLD if start is None or start.q is None else _SINGULAR
            own = found[place].q
            if own is not None and not same_posture(q, own):
                return "the targets that may stand before it lead to several postures there"
        return ""

    def _ways(self, place: int, found: Mapping[int, _Known]) -> Iterable[tuple[_Known | None, Array | None]]:
        """What may stand before a pose, None where that is not known, and the joints to which the way leads."""
        for arrival in self._poses[place].target.arrivals:
            for before in sorted(arrival.after):
                start = found.get(before)
                yield start, self._end(None if start is None else start.q, arrival.is_joint, place)

    def _end(self, start: Array | None, is_joint: bool, place: int) -> Array | None:
        """Joints at a pose by a way to it from joints; None where this does not tell them."""
        key = (b"" if start is None else start.tobytes(), place, is_joint)
        if key not in self._ends:
            goal, told = self._poses[place].goal, self._poses[place].target.configuration
            assert goal is not None
            end = None if start is None or is_joint else along(self._nominal, start, goal)
            if end is None and (told != NO_CONFIGURATION or (is_joint and start is not None)):
                (posture,) = postures_at(self._nominal, [Place(goal, told, start)])
                end = posture.q
            self._ends[key] = end
        return self._ends[key]


def _where_the_tool_is_known(correction: Correction, known: Sequence[_Known]) -> Correction:
    """Correction in which poses for another tool point count as not reached where positions alone are corrected."""
    if correction.kind == "pose":
        return correction
    own = measured_point_on_flange(correction.robot)
    reached, reasons = correction.reached.copy(), list(correction.reasons)
    for k, each in enumerate(known):
        away_mm = float(np.linalg.norm(each.flange_T_tool[:3, 3] - own))
        if each.target.kind == "pose" and reached[k] and away_mm > SAME_POINT_MM:
            reached[k] = False
            reasons[k] = (
                f"only the position of robot.toml's tool point is corrected, and this tool's point is "
                f"{numbers.length(away_mm)} from it; --what pose corrects the attitude too"
            )
    return replace(correction, reached=reached, reasons=tuple(reasons))
