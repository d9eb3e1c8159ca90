"""Names that a user may choose from. Nothing is imported here, so that `inspector --help` answers at once."""

from __future__ import annotations

RESIDUAL_KINDS = (
    "position",
    "distance",
    "pairs",
    "pose",
)  # what a fit may be of: `calib.fitting.position_residuals`
CORRECTION_KINDS = (
    "position",
    "pose",
)  # what a correction may bring right: `calib.compensation.target_correction`
BUILTIN_ROBOTS = ("rb5", "panda")  # `calib.dataset.files.robot_toml`
