"""What this extra brings: forms of a robot's file, and the nominal tables of Universal Robots' arms."""

from __future__ import annotations

from calib.consistency.known_tables import KnownTables
from calib.robot_formats.robot_form import RobotForm

_HERE = "calib.extras.robot_forms"

CONTRIBUTIONS = (
    RobotForm((".xacro",), 2, "by its suffix .xacro", f"{_HERE}.xacro_files:read_xacro", options=("tip", "base")),
    RobotForm((".xml",), 3, "a MuJoCo model", f"{_HERE}.mjcf:read_mjcf", "<mujoco", ("tip", "base")),
    RobotForm(
        (".conf",), 4, "a controller's calibration.conf", f"{_HERE}.ur_calibration:read_conf", options=("model",)
    ),
    KnownTables(f"{_HERE}.ur_calibration:nominal_robots"),
)  # fmt: skip
