"""Templates of programs (Jinja2, in `templates/`): valid names, printable texts and joint values for them.

Reserved words: Universal Robots, *The URScript Programming Language*; KUKA, *KSS System Software, Operating and
Programming Instructions for System Integrators*; ABB, *RAPID Overview* (reserved words, predefined speeds and zones).
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined

from calib.array_types import BoolArray
from calib.errors import CalibError
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
_JOINTS = 6  # that a joint position of these languages holds
_LONGEST_LABEL = 40  # characters, as a string of RAPID holds 80, and the recorded joints follow it


@dataclass(frozen=True)
class TemplatePose:
    """A joint target as a template sees it: of a list, a pose to measure, or a point on the way to it."""

    name: str  # valid in every language
    label: str  # the user's name for it, printable ASCII without quotes and backslashes
    rad: tuple[float, ...]  # joint values as commanded, rad, of prismatic joints mm
    deg: tuple[float, ...]  # the same in degrees, of prismatic joints mm
    left_out: str = ""  # why
    number: int = 0  # of a pose to measure, from 1, in the order of measuring
    way: tuple[TemplatePose, ...] = ()
    ask: str = ""


def template_pose(name: str, target: JointTarget, is_revolute: BoolArray) -> TemplatePose:
    """A joint target by its name in the program."""
    deg = np.where(is_revolute, np.degrees(target.q), target.q).tolist()
    label = quoted(target.name)[:_LONGEST_LABEL]
    return TemplatePose(name, label, tuple(target.q.tolist()), tuple(deg), plain_line(target.left_out))


def rendered(template: str, values: Mapping[str, object]) -> str:
    """Text of a template with its values."""
    text = (files("calib.extras.robot_programs") / "templates" / template).read_text(encoding="utf-8")
    return _ENVIRONMENT.from_string(text).render(values)


def require_joints(path: Path, language: str, is_revolute: Sequence[bool], remedy: str = "") -> None:
    """Raise CalibError for an arm whose joint values the controller's joint positions cannot hold."""
    if list(is_revolute) != [True] * _JOINTS:
        turning = sum(map(bool, is_revolute))
        sliding = len(is_revolute) - turning
        raise CalibError(
            f"{path}: a joint position of {language} holds six turning joints, this arm has {turning}"
            + (f" and {sliding} sliding" if sliding else "")
            + remedy
        )


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


def quoted(text: str) -> str:
    """Text for a string of any language: one line of printable ASCII without quotes and backslashes."""
    return plain_line(text).replace('"', "'").replace("\\", "/")


def _digits(values: float | Sequence[float], decimals: int, between: str = ", ") -> str:
    """One number or several with so many decimals."""
    every = [values] if isinstance(values, int | float) else values
    return between.join(f"{value:.{decimals}f}" for value in every)


_ENVIRONMENT = Environment(
    undefined=StrictUndefined, autoescape=False, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
)
_ENVIRONMENT.filters |= {"digits": _digits, "radians": np.radians, "wrapped": textwrap.wrap}
