"""What robot programs bring to the commands and the page."""

from __future__ import annotations

from inspector.plugins import CommandOptions, PlanFile, TargetFile

_HERE = "inspector.extras.robot_programs"
_PROGRAM = "calib.extras.robot_programs.measuring_program:measuring_program"
_HINT = "moves to each pose and stands there for 3 s; its routine measure_here is where to trigger an instrument"

CONTRIBUTIONS = (
    CommandOptions("plan", f"{_HERE}.options:PlanProgramOptions", f"{_HERE}.measuring:MeasuringProgram"),
    CommandOptions("correct", f"{_HERE}.options:CorrectProgramOptions", f"{_HERE}.correcting:CorrectedProgram"),
    TargetFile(
        (".script", ".src", ".dat", ".mod"), f"{_HERE}.correcting:read_program", f"{_HERE}.correcting:correct_program"
    ),
    PlanFile("Program", "UR", "measure.script", _PROGRAM, 6, _HINT),
    PlanFile("Program", "KUKA", "measure.src", _PROGRAM, 6, _HINT),
    PlanFile("Program", "ABB", "measure.mod", _PROGRAM, 6, _HINT),
)
