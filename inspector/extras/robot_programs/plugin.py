"""What robot programs bring to the commands and the page."""

from __future__ import annotations

from inspector.plugins import CommandOptions, PlanFile

_HERE = "inspector.extras.robot_programs"
_FILES, _PROGRAM = "inspector.export.plan_files:files_of_plan", f"{_HERE}.planned_program:usual_program"
_HINT = "moves to each pose and stands there for 3 s; triggers and speeds: inspector plan --program"

CONTRIBUTIONS = (
    CommandOptions("plan", f"{_HERE}.options:PlanProgramOptions", f"{_HERE}.measuring:MeasuringProgram"),
    CommandOptions("correct", f"{_HERE}.options:CorrectProgramOptions", f"{_HERE}.correcting:CorrectedProgram"),
    PlanFile("Download", "URScript", "planned_poses.script", _FILES, turning_joints=6),
    PlanFile("Program", "UR", "measure.script", _PROGRAM, 6, _HINT),
    PlanFile("Program", "KUKA", "measure.src", _PROGRAM, 6, _HINT),
    PlanFile("Program", "ABB", "measure.mod", _PROGRAM, 6, _HINT),
)
