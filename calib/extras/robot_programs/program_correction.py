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
from calib.extras.robot_programs.program_targets import Frames, Program, frame_of, require_frames
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
    moved_mm: float  # of the commanded tool point; nan where not reached
    moved_deg: float  # of the commanded tool
    uncorrected_mm: float  # error of the calibrated arm without correction; nan where unknown
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
    tool: Array | Frames | None = None,
    work: Array | Frames | None = None,
) -> ProgramCorrection:
    """Program with corrected targets, and what became of each.

    Args:
        program: the program as it was read.
        nominal: robot that the controller computes with.
        calibrated: a calibration, a diagnosis, a model from a file, a robot.
        kind: "pose", "position", or None for what the fit determines.
        tool: (4, 4) flange_T_tool, mm, of targets whose tool the program does not define, or several by their names.
        work: (4, 4) base_T_work, mm, of targets whose work frame it does not define, or several by their names.

    Raises:
        CalibError: a frame that is neither defined nor given.
    """
    tools, works = _frames(tool), _frames(work)
    require_frames(program, tools, works)
    known = _with_joints(program, nominal, tools, works)
    rows = [k for k, each in enumerate(known) if each.q is not None]
    row_of = {k: row for row, k in enumerate(rows)}
    q0 = np.array([known[k].q for k in rows]).reshape(-1, nominal.n_joints)
    ids = [program.targets[k].name for k in rows]
    correction = correction_of(nominal, calibrated, q0, kind=kind, ids=ids)
    correction = _where_the_tool_is_known(correction, [known[k] for k in rows])
    moves: list[TargetMove] = []
    values: dict[int, Array] = {}
    flanges = [flange_frames(nominal, q) for q in (correction.q_nominal, correction.q)]
    commanded = nominal.commands_of(correction.q)
    for k, each in enumerate(known):
        row = row_of.get(k)
        if row is None:
            moves.append(TargetMove(each.target, None, False, np.nan, np.nan, np.nan, each.reason))
            continue
        before, after = (flange[row] @ each.flange_T_tool for flange in flanges)
        reached = bool(correction.reached[row])
        turn = np.linalg.norm(frames.rotvec_from_rotation(before[:3, :3].T @ after[:3, :3]))
        moves.append(
            TargetMove(
                each.target,
                row,
                reached,
                float(np.linalg.norm(after[:3, 3] - before[:3, 3])) if reached else np.nan,
                float(np.degrees(turn)) if reached else np.nan,
                float(correction.uncorrected_mm[row]),
                correction.reasons[row],
                each.posture,
            )
        )
        if reached and each.target.kind == "joints":
            q = commanded[row]
            values[k] = q if program.language == "URScript" else np.degrees(q)
        elif reached:
            work_T_tool = frames.invert(each.base_T_work) @ after
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


def _frames(given: Array | Frames | None) -> Frames:
    if isinstance(given, Mapping):
        return given
    return {} if given is None else {"": given}


def _with_joints(program: Program, nominal: Robot, tools: Frames, works: Frames) -> list[_Known]:
    """Each target with its joints: as written, or of the nominal arm at its pose, in the program's posture."""
    known: dict[int, _Known] = {}
    poses: dict[int, tuple[Array, _Known]] = {}
    for target in program.targets:
        if target.kind == "joints":
            q = _written(program, nominal, target.values)
            known[target.place] = _Known(target, q, flange_T_tip(nominal), np.eye(4))
            continue
        open_ = _Known(target, None, frame_of(target.tool, tools), frame_of(target.work, works))
        try:
            base_T_tool = open_.base_T_work @ pose_transform(program.language, target.values)
        except ValueError as error:
            known[target.place] = replace(open_, reason=str(error))
            continue
        poses[target.place] = base_T_tool @ frames.invert(open_.flange_T_tool), open_
    told = {
        place: (BY_NEAR if each.target.near else BY_CONFIGURATION)
        for place, (_, each) in poses.items()
        if each.target.near or (each.target.configuration != NO_CONFIGURATION and not each.target.keeps_posture)
    }
    found = postures_at(nominal, [_place(program, nominal, *poses[place]) for place in told])
    for place, posture in zip(told, found, strict=True):
        if not posture.several:
            known[place] = replace(poses.pop(place)[1], q=posture.q, reason=posture.reason, posture=told[place])
    known |= _Ways(program, nominal, known, poses).followed()
    return [known[target.place] for target in program.targets]


def _written(program: Program, nominal: Robot, values: Array) -> Array:
    """Joints (n,), rad, of values in the program's own units."""
    return nominal.joints_of(values if program.language == "URScript" else np.radians(values))


def _place(program: Program, nominal: Robot, base_T_flange: Array, known: _Known) -> Place:
    near = _written(program, nominal, np.array(known.target.near)) if known.target.near else None
    return Place(base_T_flange, known.target.configuration, near)


class _Ways:
    """Postures of poses that follow from those before them: kept on a linear motion, the nearest after another one."""

    def __init__(
        self, program: Program, nominal: Robot, known: dict[int, _Known], poses: dict[int, tuple[Array, _Known]]
    ) -> None:
        self._program, self._nominal, self._known, self._poses = program, nominal, known, poses
        self._ends: dict[tuple[int, int, bool], tuple[Array | None, Array | None]] = {}
        self._open: dict[int, str] = {}  # reasons why postures are not told

    def followed(self) -> dict[int, _Known]:
        """The poses with their joints, or with the reason why these are not told."""
        while True:
            found = self._spread()
            doubts = {place: doubt for place in found if (doubt := self._doubt(place, found))}
            if not doubts:
                break
            self._open |= doubts
        left = {place: each for place, (_, each) in self._poses.items() if place not in found}
        reasons = {place: {self._lacks(before, found) for before, _ in self._ways(place)} for place in left}
        singular = {place: _SINGULAR for place, each in reasons.items() if _SINGULAR in each}
        told = dict.fromkeys(left, _NOT_TOLD) | singular | self._open
        return found | {place: replace(each, reason=told[place]) for place, each in left.items()}

    def _spread(self) -> dict[int, _Known]:
        """Joints of the poses that can be reached from known ones, each by its first way."""
        found: dict[int, _Known] = {}
        waiting = [place for place in self._poses if place not in self._open]
        while waiting:
            for place in waiting:
                for before, is_joint in self._ways(place):
                    q = self._end(before, is_joint, place, found)
                    if q is not None:
                        one = self._known_at(before, found)
                        told = one.target.name if one is not None and one.q is not None else BY_CONFIGURATION
                        found[place] = replace(self._poses[place][1], q=q, posture=told)
                        break
            still = [place for place in waiting if place not in found]
            if len(still) == len(waiting):
                break
            waiting = still
        return found

    def _doubt(self, place: int, found: dict[int, _Known]) -> str:
        """Why the joints that were found of a pose may be others; "" where all ways lead to them."""
        for before, is_joint in self._ways(place):
            q = self._end(before, is_joint, place, found)
            if q is None:
                return self._lacks(before, found)
            own = found[place].q
            if own is not None and not same_posture(q, own):
                return "the targets that may stand before it lead to several postures there"
        return ""

    def _lacks(self, before: int, found: dict[int, _Known]) -> str:
        """Why the way from a place does not tell a posture."""
        known = self._known_at(before, found)
        return _NOT_TOLD if known is None or known.q is None else _SINGULAR

    def _ways(self, place: int) -> list[tuple[int, bool]]:
        """Places before a pose, and whether a joint motion leads from each to it."""
        arrivals = self._poses[place][1].target.arrivals
        return [(before, arrival.is_joint) for arrival in arrivals for before in sorted(arrival.after)]

    def _known_at(self, place: int, found: dict[int, _Known]) -> _Known | None:
        return self._known.get(place) or found.get(place)

    def _end(self, before: int, is_joint: bool, place: int, found: dict[int, _Known]) -> Array | None:
        """Joints at a pose by one way to it; None where this does not tell them."""
        known = self._known_at(before, found)
        start = None if known is None else known.q
        kept = self._ends.get((before, place, is_joint))
        if kept is not None and kept[0] is start:
            return kept[1]
        goal, each = self._poses[place]
        end = None if start is None or is_joint else along(self._nominal, start, goal)
        told = each.target.configuration if is_joint or start is None or end is None else NO_CONFIGURATION
        if end is None and (told != NO_CONFIGURATION or (is_joint and start is not None)):
            (posture,) = postures_at(self._nominal, [Place(goal, told, start)])
            end = posture.q
        self._ends[before, place, is_joint] = start, end
        return end


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
