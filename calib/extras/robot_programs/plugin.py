"""What this extra brings: files of joint targets in the languages of controllers."""

from __future__ import annotations

from calib.robot_formats.target_form import TargetForm

_HERE = "calib.extras.robot_programs.point_lists"

CONTRIBUTIONS = tuple(
    TargetForm(name, (suffix,), f"{_HERE}:point_list", f"{_HERE}:require_point_list")
    for suffix, name in {".script": "URScript", ".dat": "KRL", ".mod": "RAPID"}.items()
)
