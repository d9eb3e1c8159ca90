"""What watching a cell brings."""

from inspector.plugins import Command

CONTRIBUTIONS = (
    Command(
        "watch",
        "inspector.extras.watch.options:WatchOptions",
        "inspector.extras.watch.watch_command:run_watch",
        after="verify",
    ),
)
