"""Joint targets as programs: point lists in URScript, KUKA KRL and ABB RAPID, and a ROS trajectory in YAML.

Joint values are those that the controller is commanded with, as in poses.csv: URScript in rad, KRL and RAPID in
degrees. Sources: Universal Robots, *The URScript Programming Language* (lists of joint positions, rad); KUKA, *KSS
System Software, Operating and Programming Instructions for System Integrators* (structure AXIS, `.dat` files); ABB,
*Technical reference manual, RAPID Instructions, Functions and Data types* (`jointtarget`, 9E9 for an axis that is not
connected) and *RAPID Overview* (reserved words, predefined speeds and zones); ROS, *trajectory_msgs/msg/
JointTrajectory* and *builtin_interfaces/msg/Duration* (positions in rad or m, seconds and nanoseconds from the start).
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError, visible
from calib.kinematics.robot import Robot
from calib.robot_formats.joint_targets import JointTarget

_URSCRIPT = """
and break continue def elif else end enter_critical exit_critical False for global goto halt if in join kill
local loop mod not or pass request_integer_from_primary_client request_string_from_primary_client return run sec
sleep struct sync thread to_num to_str True while xor acos asin atan atan2 ceil cos d2r exp floor length log
norm pow r2d random sin sqrt tan size str_at str_cat str_empty str_find str_len str_sub inv interpolate_pose
point_dist pose_add pose_dist pose_inv pose_sub pose_trans rotvec2rpy rpy2rotvec wrench_trans
binary_list_to_integer integer_to_binary_list get_list_length make_list transpose conveyor_pulse_decode
encoder_enable_pulse_decode end_force_mode end_freedrive_mode end_teach_mode force force_mode freedrive_mode
movec movej movel movep servoc servoj servol set_conveyor_tick_count speedj speedl stopj stopl
stop_conveyor_tracking teach_mode track_conveyor_circular track_conveyor_linear position_deviation_warning
reset_revolution_counter get_actual_joint_positions get_actual_joint_speeds get_actual_tcp_pose
get_actual_tcp_speed get_forward_kin get_inverse_kin get_inverse_kin_has_solution get_target_joint_positions
get_target_joint_speeds get_target_payload get_target_tcp_pose get_target_tcp_speed get_tcp_force get_tcp_offset
get_joint_temp get_joint_torques get_controller_temp get_steptime is_steady is_within_safety_limits popup
powerdown set_gravity set_payload set_payload_cog set_payload_mass set_target_payload set_tcp textmsg
socket_open socket_close socket_get_var socket_read_line socket_read_string socket_send_line socket_send_string
socket_set_var get_analog_in get_analog_out get_digital_in get_digital_out set_analog_out set_digital_out
get_standard_analog_in get_standard_digital_in set_standard_digital_out get_tool_digital_in set_tool_digital_out
get_configurable_digital_in get_flag set_flag get_euromap_input set_tool_voltage rpc_factory zero_ftsensor p
"""
_KRL = """
and anin anout array axis b_and b_exor b_not b_or bas bool brake case channel char circ circ_rel confirm const
continue copen cclose cread cwrite c_dis c_ori c_ptp c_vel c_spl c_jerk decl def default defdat deffct delay
distance do e6axis e6pos else end enddat endfct endfor endif endloop endspline endswitch endwhile enum exit exor
ext extfct extfctp false fdat for frame global go goto halt if import in int interrupt is ldat lin lin_rel loop
maximum minimum not off on or pdat pos prio ptp ptp_rel public pulse real repeat resume return scirc scirc_rel
sec signal slin slin_rel spline spl sptp sptp_rel sread step strlen struc swrite switch then to tool_data
trigger true until wait when while with abs acos asin atan atan2 cos sin sqrt tan round inverse forward inv_pos
strcomp strcopy stradd strfind strclear strdeclen load
"""
_RAPID = """
alias and backward case connect const default div do else elseif endfor endfunc endif endmodule endproc
endrecord endtest endtrap endwhile error exit false for from func goto if inout local mod module nostepin not
noview or pers proc raise readonly record retry return step sysmodule task test then to trap true trynext undo
var viewonly while with xor abs acos add asin atan atan2 bool bitand byte break ceil clear clkread clkreset
clkstart clkstop clock close confdata confj confl cos crobt cjointt decr distance errnum exp extjoint fine floor
incr intnum jointtarget label loaddata load load0 moveabsj movec movej movel norm num dnum open orient
orienteuler orientzyx pi pos pose pow pulsedo read reltool reset robjoint robtarget round set setao setdo setgo
shapedata signalai signalao signaldi signaldo signalgi signalgo sin singarea speeddata sqrt stop stoppointdata
stopmove startmove strlen strfind string switch tan tooldata tool0 tpwrite trunc unload velset waitdi waitdo
waittime waituntil wobjdata wobj0 write zonedata
"""
_SPEEDS = (5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500, 3000, 4000,
           5000, 6000, 7000)  # fmt: skip
_ZONES = (0, 1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)
RESERVED = frozenset(
    {word.lower() for words in (_URSCRIPT, _KRL, _RAPID) for word in words.split()}
    | {f"v{speed}" for speed in _SPEEDS}
    | {f"z{zone}" for zone in _ZONES}
    | {"vmax", "fine"}
)  # lower case; a word of one language is kept free in all of them


JOINTS = 6  # that a joint position of these languages holds
LONGEST = {".script": 64, ".dat": 24, ".mod": 32}  # characters of a name: KRL 24, RAPID 32; URScript tells no limit
LANGUAGES = {".script": "URScript", ".dat": "KRL", ".mod": "RAPID"}
_COMMENT = {".script": "#", ".dat": ";", ".mod": "!"}


def require_point_list(path: Path, robot: Robot) -> None:
    """Raise CalibError for an arm whose joint values the point list of a file's suffix cannot hold."""
    require_joints(path, LANGUAGES[path.suffix.lower()], robot.is_revolute.tolist(), "; write the targets as .csv")


def require_joints(path: Path, language: str, is_revolute: Sequence[bool], remedy: str = "") -> None:
    """Raise CalibError for an arm whose joint values the controller's joint positions cannot hold."""
    if list(is_revolute) != [True] * JOINTS:
        turning = sum(map(bool, is_revolute))
        sliding = len(is_revolute) - turning
        raise CalibError(
            f"{path}: a joint position of {language} holds six turning joints, this arm has {turning}"
            + (f" and {sliding} sliding" if sliding else "")
            + remedy
        )


def point_list(path: Path, robot: Robot, targets: Sequence[JointTarget], heading: Sequence[str]) -> str:
    """Point list in the language of the file's suffix; targets that are left out become comments with the reason.

    heading: first lines, as comments. The arm has to pass `require_point_list`.
    """
    suffix = path.suffix.lower()
    comment = _COMMENT[suffix]
    whole, *names = identifiers([path.stem, *(target.name for target in targets)], LONGEST[suffix])
    unit = "rad" if suffix == ".script" else "degrees"
    lines = [f"{comment} {plain_line(words)}" for words in (*heading, f"Joint values in {unit}.")]
    for name, target in zip(names, targets, strict=True):
        original = f"  {comment} {plain_line(target.name)}" if name != target.name else ""
        if target.left_out:
            lines.append(f"{comment} {name} is left out: {plain_line(target.left_out)}")
        else:
            lines.append(_line(suffix, name, target.q) + original)
    return "\n".join(_wrapped(suffix, whole, lines)) + "\n"


def _line(suffix: str, name: str, q: Array) -> str:
    if suffix == ".script":
        return f"{name} = [{', '.join(f'{v:.9f}' for v in q)}]"
    angles = [f"{v:.7f}" for v in np.degrees(q)]
    if suffix == ".dat":
        return f"DECL GLOBAL AXIS {name}={{{','.join(f'A{k} {v}' for k, v in enumerate(angles, 1))}}}"
    return f"  CONST jointtarget {name}:=[[{','.join(angles)}],[{','.join(['9E9'] * JOINTS)}]];"


def _wrapped(suffix: str, name: str, lines: list[str]) -> list[str]:
    if suffix == ".dat":
        return [f"DEFDAT {name} PUBLIC", *lines, "ENDDAT"]
    if suffix == ".mod":
        return [f"MODULE {name}", *lines, "ENDMODULE"]
    return lines


def identifiers(ids: Sequence[str], longest: int) -> list[str]:
    """Names valid in all three languages, unique without regard to case: letters, digits and underscores.

    A reserved word of one of the languages gets the prefix `p_`.
    """
    out: list[str] = []
    taken: set[str] = set()
    for pose_id in ids:
        base = re.sub(r"[^A-Za-z0-9_]", "_", pose_id)
        base = (base if base[:1].isalpha() else f"p{base}")[:longest]
        base = f"p_{base}"[:longest] if base.lower() in RESERVED else base
        name, number = base, 1
        while name.lower() in taken:
            number += 1
            name = f"{base[: longest - len(str(number)) - 1]}_{number}"
        taken.add(name.lower())
        out.append(name)
    return out


def plain_line(text: str) -> str:
    """Text as one line of printable ASCII, for a comment of a program."""
    return re.sub(r"[^ -~]", "?", " ".join(text.split()))


SLOW_RAD_S, SLOW_MM_S = 0.25, 50.0  # of the joint that moves the most between two targets
STANDS_S = 3.0  # at each target, for the measurement
_FIRST_S = 10.0  # to the first target, from wherever the arm stands


def trajectory_yaml(path: Path, robot: Robot, targets: Sequence[JointTarget], heading: Sequence[str]) -> str:
    """ROS trajectory through the targets in their order, with a stop of some seconds (two points) at each.

    heading: first lines, as comments.
    """
    names = [joint.name or f"joint{k + 1}" for k, joint in enumerate(robot.joints)]
    lines = [
        *(f"# {visible(' '.join(words.split()))}" for words in heading),
        f"# trajectory_msgs/msg/JointTrajectory; {STANDS_S:g} s at each target, joints at most "
        f"{SLOW_RAD_S:g} rad/s or {SLOW_MM_S:g} mm/s",
        "header:",
        "  stamp: {sec: 0, nanosec: 0}",
        "  frame_id: ''",
        f"joint_names: [{', '.join(json.dumps(name) for name in names)}]",
        "points:" if targets else "points: []",
    ]
    for (target, arrives_s), k in zip(_times(robot, targets), range(len(targets)), strict=True):
        position = np.where(robot.is_revolute, target.q, target.q / 1000.0)
        position_text = f"[{', '.join(f'{v:.9f}' for v in position)}]"
        still = f"[{', '.join(['0.0'] * len(position))}]"
        for seconds in (arrives_s, arrives_s + STANDS_S):
            whole = int(seconds)
            lines += [
                f"- positions: {position_text}  # {json.dumps(target.name)}, number {k + 1}",
                f"  velocities: {still}",
                f"  time_from_start: {{sec: {whole}, nanosec: {round((seconds - whole) * 1e9)}}}",
            ]
    return "\n".join(lines) + "\n"


def _times(robot: Robot, targets: Sequence[JointTarget]) -> list[tuple[JointTarget, float]]:
    """Each target with its time of arrival, s, rounded up to tenths."""
    speed = np.where(robot.is_revolute, SLOW_RAD_S, SLOW_MM_S)
    out: list[tuple[JointTarget, float]] = []
    at: Array | None = None
    now = _FIRST_S
    for target in targets:
        if at is not None:
            # a smooth way from rest to rest is half as fast again in its middle as on average
            now += STANDS_S + max(1.0, 1.5 * float(np.max(np.abs(target.q - at) / speed)))
        now = float(np.ceil(10.0 * now) / 10.0)
        out.append((target, now))
        at = target.q
    return out
