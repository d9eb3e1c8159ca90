"""What following a campaign brings to the commands and the page."""

from inspector.plugins import Command, Tab

CONTRIBUTIONS = (
    Command(
        "follow",
        "inspector.extras.follow.options:FollowOptions",
        "inspector.extras.follow.follow_command:run_follow",
        after="repeat",
    ),
    Tab(
        "Measure",
        "Live",
        order=40,
        panel="inspector.extras.follow.live_panel:LivePanel",
        controller="inspector.extras.follow.live_controller:LiveController",
    ),
)
