"""What robot programs bring."""

from inspector.plugins import CommandOptions

_HERE = "inspector.extras.robot_programs"

CONTRIBUTIONS = (
    CommandOptions("plan", f"{_HERE}.options:PlanProgramOptions", f"{_HERE}.measuring:MeasuringProgram"),
    CommandOptions("correct", f"{_HERE}.options:CorrectProgramOptions", f"{_HERE}.correcting:CorrectedProgram"),
)
