"""Options that cameras add to `calibrate` and `import`. Nothing slow is imported."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from inspector.cli.options.declaration import option


@dataclass(frozen=True, kw_only=True)
class HandEyeOptions:
    """Where the camera is, as a file for ROS."""

    hand_eye_out: Path | None = option(
        "write where the camera is, for ROS, as .yaml; with --residual pose",
    )
    parent_frame: str | None = option(
        "your robot's name of the frame that carries the camera, such as tool0; of the base: base_link by default",
        metavar="NAME",
    )
    parent_at: str = option(
        "which frame that is: the controller's flange, as robot.toml's [flange] has it (default), or the end of its "
        "tool row",
        "flange",
        choices=("flange", "tip"),
    )
    camera_frame: str = option(
        "its name of the camera's optical frame (default camera_optical_frame)", "camera_optical_frame", metavar="NAME"
    )


@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """Options of an import of what a camera sees."""

    images: Path | None = option("images of a board, one a pose (extra `camera`)", metavar="FOLDER")
    board: str | None = option(
        "what they show: charuco:8x6:30:22 (squares, mm of a square, mm of a marker), checkerboard:9x6:25, "
        "apriltag:6x6:40:12 (tags, mm of a tag, mm of a gap), apriltag:50 (a single one), aruco:...",
        metavar="KIND:SIZES",
    )
    dictionary: str | None = option("of the markers, such as DICT_4X4_50 (default: by the images)", metavar="NAME")
    intrinsics: Path | None = option(
        "the lens: ROS camera_info.yaml, OpenCV's YAML, XML or JSON (default: found from the images)"
    )
    marker_poses: Path | None = option(
        "poses of a marker in the camera's frame that another program measured: a table, YAML of ROS or easy_handeye, "
        "OpenCV's files",
    )
    mount: str | None = option("where the camera is (default: what the poses clearly show)", choices=("flange", "room"))
