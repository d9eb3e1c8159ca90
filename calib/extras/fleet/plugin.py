"""What fleets bring: what is told of them and of types of arms."""

from calib.plugins import Presentations

CONTRIBUTIONS = (Presentations(("calib.extras.fleet.present.arm_types", "calib.extras.fleet.present.fleets")),)
