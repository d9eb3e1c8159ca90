"""What watching brings: `calib.watch`, what is told of it, and check poses as a purpose of `plan`."""

from calib.planning.purpose import PlanPurpose
from calib.plugins import Presentations, PublicNames

WATCH = "watch"
CHECK_POSES = 8

CONTRIBUTIONS = (
    PublicNames("calib.extras.watch.watch", ("ChangeReport", "watch")),
    Presentations(("calib.extras.watch.present.changes", "calib.extras.watch.present.check_poses")),
    PlanPurpose(
        WATCH,
        "check poses that show a change",
        "watch (8 check poses)",
        criterion="calib.extras.watch.watch_criterion:ForWatch",
        usual_count=CHECK_POSES,
    ),
)
