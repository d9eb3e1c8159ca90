"""What `import` takes of a camera."""

from __future__ import annotations

from dataclasses import replace

from calib.dataset_import.plan import ImportSources
from calib.extras.camera.importing.camera_import import CameraImport
from calib.extras.camera.importing.camera_views import CameraChoice
from inspector.cli.additions import ImportAddition
from inspector.cli.options.datasets import ImportOptions
from inspector.extras.camera.options import CameraOptions


class CameraAddition(ImportAddition[CameraOptions, ImportOptions]):
    """Images, poses of a marker, and poses of the flange."""

    def chosen(self, choice: ImportSources) -> ImportSources:
        """What was chosen, with what the camera's options say."""
        camera = CameraChoice(**vars(self.asked), flange_poses=self.command.flange_poses)
        camera.require_consistent()
        return replace(choice, to_measure=CameraImport(camera)) if camera.is_given else choice
