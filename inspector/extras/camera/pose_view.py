"""What the page shows of the image at the selected pose: its corners, and the reprojection by the model on show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import plotly.graph_objects as go

from calib.extras.camera.observed import CameraViews, camera_of, image_path
from calib.extras.camera.reprojection import ReprojectedView, reprojected_views
from calib.extras.camera.view import View as BoardView
from inspector.extras.camera.reprojection_plot import reprojected_corners
from inspector.session.view import View

_PLOT_PX = 330  # width of an image beside the axis of a figure of the panel


def image_at(view: View) -> ImageAtPose | None:
    """The image at the selected pose; None where no camera measured the dataset."""
    camera = camera_of(view.session.dataset)
    return None if camera is None else ImageAtPose(view, camera)


@dataclass(frozen=True)
class ImageAtPose:
    """The image at the selected pose, as the tab of scans shows it."""

    view: View
    camera: CameraViews
    note: str = (
        "The image at the selected pose: the board's corners as they were found, with arrows from where the fitted "
        "arm, camera and board put them. Look for an image far worse than the others, and for arrows that all point "
        "one way."
    )

    @property
    def seen(self) -> BoardView | None:
        """Corners that the camera saw; None where it did not see the board."""
        return self.camera.of(self.view.pose_id)

    @property
    def column(self) -> tuple[str, Mapping[str, str]] | None:
        """RMS error of each image's corners, where full poses are fitted."""
        fitted = self._reprojections()
        cells = {pose_id: f"{one.rms_px:.3f}" for pose_id, one in fitted.items()}
        return ("reprojection, px", cells) if fitted else None

    def figure(self) -> tuple[go.Figure, float] | None:
        """Figure of the image with the reprojection by the model on show, and its height over its width."""
        seen, fitted = self.seen, self._reprojections().get(self.view.pose_id)
        if seen is None:
            return None
        width, height = self.camera.lens.size_px
        aspect = (height / width * _PLOT_PX + 72) / (_PLOT_PX + 72)  # with room for the axes
        predicted = None if fitted is None else fitted.predicted
        return reprojected_corners(self.view.session.dataset, seen, predicted), aspect

    def facts(self) -> list[tuple[str, object]]:
        """File, corners and reprojection of the image; [] where it does not show the board."""
        seen, fitted = self.seen, self._reprojections().get(self.view.pose_id)
        if seen is None:
            return []
        image = image_path(self.view.session.dataset, self.view.pose)
        rows: list[tuple[str, object]] = [
            ("image", "not kept in the dataset's folder" if image is None else image.name),
            ("corners of the board", len(seen.corner)),
        ]
        if fitted is not None:
            noise = f"noise {self.camera.sigma_px:.3f}"
            rows.append(("reprojection", f"{fitted.rms_px:.3f} pixels per coordinate, RMS ({noise})"))
        return rows

    def _reprojections(self) -> dict[str, ReprojectedView]:
        """Reprojection at each pose by the model on show; {} for the nominal robot, or with no full poses fitted."""
        if self.view.calibration is None or self.view.is_nominal:
            return {}
        return {one.view.pose: one for one in reprojected_views(self.view.calibration)}
