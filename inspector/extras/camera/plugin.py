"""What cameras bring."""

from inspector.plugins import CommandOptions, Figures, PoseView

_HERE = "inspector.extras.camera"

CONTRIBUTIONS = (
    CommandOptions("calibrate", f"{_HERE}.options:HandEyeOptions", f"{_HERE}.hand_eye_file:HandEyeFile"),
    CommandOptions("import", f"{_HERE}.options:CameraOptions", f"{_HERE}.camera_choice:CameraAddition"),
    Figures(f"{_HERE}.figures", ("reprojection",)),
    PoseView(f"{_HERE}.pose_view:image_at"),
)
