"""What fleets bring to the commands and the figures."""

from inspector.plugins import CalibrationStart, Command, Figures

CONTRIBUTIONS = (
    Command(
        "pool",
        "inspector.extras.fleet.options:PoolOptions",
        "inspector.extras.fleet.fleet_command:run_pool",
        after="verify",
    ),
    Command(
        "fleet",
        "inspector.extras.fleet.options:FleetOptions",
        "inspector.extras.fleet.fleet_command:run_fleet_command",
        after="check",
    ),
    CalibrationStart("inspector.extras.fleet.start_from_type:start_from_type"),
    Figures("inspector.extras.fleet.figures", ("fleet_errors",)),
)
