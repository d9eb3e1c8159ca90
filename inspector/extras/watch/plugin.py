"""What watching a cell brings to the commands and the page."""

from inspector.plugins import Command, Figures, Tab

CONTRIBUTIONS = (
    Command(
        "watch",
        "inspector.extras.watch.options:WatchOptions",
        "inspector.extras.watch.watch_command:run_watch",
        after="repeat",
    ),
    Tab(
        "Model",
        "Watch",
        order=50,
        panel="inspector.extras.watch.watch_panel:WatchPanel",
        controller="inspector.extras.watch.watch_controller:WatchController",
        view="Arm",
    ),
    Figures("inspector.extras.watch.watch_plots", ("control_chart",)),
)
