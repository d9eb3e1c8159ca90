"""What a camera measured, beside the table of the arm's poses, as sources of an import."""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib.dataset_import.plan import ImportSources
from calib.extras.camera.importing.camera_views import CameraChoice, camera_points, ids_of
from calib.extras.camera.importing.cartesian_poses import joints_table, table_of_arm
from calib.progress import OnProgress
from calib.robot_formats.conventions import RobotReading
from calib.robot_formats.robot_file import RobotFile


@dataclass(frozen=True)
class CameraImport:
    """A camera's images or marker poses, to be measured by an import."""

    choice: CameraChoice

    @property
    def unit(self) -> str:
        """Images are measured one after the other."""
        return "" if self.choice.images is None else "image"

    def sources(self, sources: ImportSources, on_progress: OnProgress | None) -> ImportSources:
        """Sources with the board poses that a camera saw. Raises CalibError.

        Where poses of the flange are given in place of joint values, an arm that stands for them comes with them.
        `on_progress` is called with (done, total, file name) after each image.
        """
        robot = sources.arm
        arm = table_of_arm(self.choice, sources.joints, robot, sources.mapping)
        ids = ids_of(arm.table, sources.mapping, None if arm.readings else robot)
        camera = camera_points(self.choice, arm.table, ids, on_progress)
        camera = replace(camera, point_sigma_mm=sources.point_sigma_mm)
        sources = replace(sources, points=None, measured=camera)
        if not arm.readings:
            return sources
        stands_for, joints, notes, doubts = joints_table(arm, camera, ids, robot)
        return replace(
            sources, robots=(RobotReading("", RobotFile(stands_for, None)),), joints=arm.table.path,
            tables={arm.table.path: joints}, notes=(*sources.notes, *notes), doubts=(*sources.doubts, *doubts),
        )  # fmt: skip
