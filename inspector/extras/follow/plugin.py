"""What following a campaign brings."""

from inspector.plugins import Command

CONTRIBUTIONS = (
    Command(
        "follow",
        "inspector.extras.follow.options:FollowOptions",
        "inspector.extras.follow.follow_command:run_follow",
        after="verify",
    ),
)
