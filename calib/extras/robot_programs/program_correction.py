"""Correction of the targets in a robot program: joints, and poses in the maker's own numbers.

A controller turns a pose into joints by its own nominal table. So a pose target becomes the nominal arm's joints there
(`calib.extras.robot_programs.postures`), these are corrected as any joint target, and the new pose is where the nominal
arm stands with the corrected joints, in the target's work frame and for its tool. The controller's flange is that of
robot.toml (`calib.kinematics.flange`), its base that of robot.toml.

A fit that determines positions alone knows them for the tool point of robot.toml: pose targets for another tool point
are then left as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.compensation.correction import Correction, Corrects
from calib.compensation.target_correction import correction_of
from calib.errors import CalibError
from calib.extras.robot_programs.postures import Place, Posture, postures_at
from calib.extras.robot_programs.program_targets import Frames, Program, frame_of, require_frames
from calib.extras.robot_programs.program_text.pose_numbers import pose_transform, pose_values
from calib.extras.robot_programs.program_text.source import ProgramTarget
from calib.kinematics.flange import flange_frames, flange_T_tip, measured_point_on_flange
from calib.kinematics.robot import Robot
from calib.rendering import numbers

SAME_POINT_MM = 0.5
"""Distance within which a program's tool point is that of robot.toml."""
_POSTURES = 500  # trained poses that are looked through for the nearest, about
BY_CONFIGURATION, BY_NEAR, BY_TRAINED = "configuration", "qnear", "trained poses"


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
    posture: str = (
        ""  # what told the posture of a pose: the configuration, qnear, a joint target's name, the trained poses
    )


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
    trained: Array,
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
        trained: (K, n) joints of known postures, of which the nearest counts where nothing else tells a pose's posture.
        kind: "pose", "position", or None for what the fit determines.
        tool: (4, 4) flange_T_tool, mm, of targets whose tool the program does not define, or several by their names.
        work: (4, 4) base_T_work, mm, of targets whose work frame it does not define, or several by their names.

    Raises:
        CalibError: a frame that is neither defined nor given.
    """
    tools, works = _frames(tool), _frames(work)
    require_frames(program, tools, works)
    known = _with_joints(program, nominal, trained, tools, works)
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
    notes = (*program.notes, *_posture_notes(moves))
    return ProgramCorrection(program, program.with_values(values), tuple(moves), correction, notes)


def _frames(given: Array | Frames | None) -> Frames:
    if isinstance(given, Mapping):
        return given
    return {} if given is None else {"": given}


def _with_joints(program: Program, nominal: Robot, trained: Array, tools: Frames, works: Frames) -> list[_Known]:
    """Each target with its joints: as written, or of the nominal arm at its pose."""
    trained = trained[:: max(1, len(trained) // _POSTURES)]
    known: list[_Known] = []
    open_: list[tuple[int, Place]] = []
    before: tuple[str, Array] | None = None  # the last target whose joints are told

    def written(values: Array) -> Array:
        return nominal.joints_of(values if program.language == "URScript" else np.radians(values))

    for target in program.targets:
        if target.kind == "joints":
            before = (target.name, written(target.values))
            known.append(_Known(target, before[1], flange_T_tip(nominal), np.eye(4)))
            continue
        flange_T_tool, base_T_work = frame_of(target.tool, tools), frame_of(target.work, works)
        try:
            base_T_tool = base_T_work @ pose_transform(program.language, target.values)
        except ValueError as error:
            known.append(_Known(target, None, flange_T_tool, base_T_work, str(error)))
            continue
        if target.near:
            before = (target.name, written(np.array(target.near)))
        name = BY_TRAINED if before is None else before[0]
        name = BY_CONFIGURATION if target.ranges_deg else BY_NEAR if target.near else name
        near = trained if before is None else before[1][None]
        flange = base_T_tool @ frames.invert(flange_T_tool)
        place = Place(flange, target.ranges_deg, near, bind=target.ranges_bind)
        open_.append((len(known), place))
        known.append(_Known(target, None, flange_T_tool, base_T_work, posture=name))
    found: list[Posture] = postures_at(nominal, [place for _, place in open_])
    for (k, _), posture in zip(open_, found, strict=True):
        known[k] = replace(known[k], q=posture.q, reason=posture.reason)
    return known


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


def _posture_notes(moves: Sequence[TargetMove]) -> list[str]:
    """Remarks on poses whose posture the program does not tell."""
    guessed = [move for move in moves if move.posture and move.posture not in (BY_CONFIGURATION, BY_NEAR)]
    trained = sum(move.posture == BY_TRAINED for move in guessed)
    joints = len(guessed) - trained
    notes = []
    if joints:
        words = "is taken as the nearest to the joint target before it"
        notes.append(f"the posture of {numbers.count(joints, 'pose')} {words}")
    if trained:
        words = "is taken as the nearest to the trained poses"
        notes.append(f"the posture of {numbers.count(trained, 'pose')} {words}")
    return notes
