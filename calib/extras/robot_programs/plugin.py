"""What this extra brings: files of joint targets in the languages of controllers, and ROS trajectories."""

from __future__ import annotations

from calib.robot_formats.target_form import TargetForm

_LISTS = "calib.extras.robot_programs.point_lists"
_WRITER, _CHECK = f"{_LISTS}:point_list", f"{_LISTS}:require_point_list"

CONTRIBUTIONS = (
    TargetForm("URScript", (".script",), _WRITER, _CHECK),
    TargetForm("KRL", (".dat",), _WRITER, _CHECK),
    TargetForm("RAPID", (".mod",), _WRITER, _CHECK),
    TargetForm("ROS", (".yaml", ".yml"), f"{_LISTS}:trajectory_yaml", is_motion=True),
)
