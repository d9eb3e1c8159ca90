"""Words that URScript, KRL or RAPID keep for themselves: keywords, types, functions and data that are always there.

Sources: those of `point_lists`; for RAPID's reserved words and predefined speeds and zones ABB, *Technical reference
manual, RAPID Overview* and *RAPID Instructions, Functions and Data types*. Of instructions and functions those are
listed that a target may well be called by.
"""

from __future__ import annotations

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
