"""What following a campaign brings: what is told of it."""

from calib.plugins import Presentations

CONTRIBUTIONS = (Presentations(("calib.extras.follow.present.campaign",)),)
