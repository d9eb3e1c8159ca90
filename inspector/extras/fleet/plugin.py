"""What fleets bring."""

from inspector.plugins import Command

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
)
