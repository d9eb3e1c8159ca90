"""What fleets bring to the commands and the figures."""

from inspector.plugins import Command, CommandOptions, PipExtra

CONTRIBUTIONS = (
    Command(
        "pool",
        "inspector.extras.fleet.options:PoolOptions",
        "inspector.extras.fleet.fleet_command:run_pool",
        after="repeat",
    ),
    Command(
        "fleet",
        "inspector.extras.fleet.options:FleetOptions",
        "inspector.extras.fleet.fleet_command:run_fleet_command",
        after="check",
    ),
    CommandOptions(
        "calibrate", "inspector.extras.fleet.options:TypeOptions", "inspector.extras.fleet.from_type:FromType"
    ),
    PipExtra("fleet", ("pebble", "distributed")),
)
