"""Tab Scans: the scan of the selected pose, and the state of all of them."""

from __future__ import annotations

import numpy as np
import viser

from calib.calibration.reprojection import ReprojectedView, reprojected_views
from calib.camera.view import View as BoardView
from calib.rendering import numbers
from calib.scans.scan import Scan
from inspector.figures.reprojection_plot import reprojected_corners
from inspector.markup.model.comparison import roles_legend
from inspector.markup.parts import elements
from inspector.markup.parts.palette import DOUBT, FAILED, LEFT_OUT, role_colour
from inspector.panels.base import Actions, FollowsModel, hidden_plot
from inspector.session.view import View, corner_of

NOTE = (
    "The selected scan in full, all others in few points, in the colour of their role. Look for scans that miss the "
    "jig, are noisy, or lie apart from the rest. A pose without a corner is left out of the fit."
)
IMAGE_NOTE = (
    "The image at the selected pose: the board's corners as they were found, with arrows from where the fitted arm, "
    "camera and board put them. Look for an image far worse than the others, and for arrows that all point one way."
)
NO_SCANS = "The points were measured (points.csv). The list gives the uncertainty of each."


PLOT_PX = 330  # width of an image beside the axis of a figure of the panel


class ScansPanel(FollowsModel):
    """Facts about the selected scan or image, and a table of all poses."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._note = gui.add_html(elements.note(NOTE))
        self._show = gui.add_button_group("In 3D", ("Show all scans",))
        self._show.on_click(lambda _: actions.show_view("All scans"))
        self._image = hidden_plot(gui, 0.8, "image")
        self._scan = gui.add_html("")
        self._all = gui.add_html("")

    def update(self, view: View) -> None:
        """Show what the model on show makes of the images, where a camera took them."""
        if view.session.dataset.camera is not None:
            self.update_scan(view, None, 0)

    def update_scan(self, view: View, scan: Scan | None, drawn: int) -> None:
        """Show the selected scan's or image's facts; `drawn` is the number of its points in the scene."""
        self._show.visible = view.session.dataset.scan_folder is not None
        with_images = view.session.dataset.camera is not None
        self._note.content = elements.note(NOTE if self._show.visible else IMAGE_NOTE if with_images else NO_SCANS)
        self._scan.content = elements.heading(f"Pose {view.pose_id}") + scan_facts(view, scan, drawn)
        self.update_image(view)
        self.update_list(view)

    def update_image(self, view: View) -> None:
        """Draw the image of the selected pose, with the reprojection by the model on show."""
        dataset, seen = view.session.dataset, image_of(view)
        self._image.visible = seen is not None
        if seen is None or dataset.camera is None:
            return
        fitted = reprojections(view).get(view.pose_id)
        width, height = dataset.camera.lens.size_px
        self._image.aspect = (height / width * PLOT_PX + 72) / (PLOT_PX + 72)  # with room for the axes
        self._image.figure = reprojected_corners(
            seen, (width, height), None if fitted is None else fitted.predicted, dataset.image_path(view.pose)
        )

    def update_list(self, view: View) -> None:
        """Refresh the table of all poses."""
        self._all.content = elements.heading("All poses") + roles_legend(view) + pose_table(view)


def image_of(view: View) -> BoardView | None:
    """Corners that the camera saw at the selected pose; None where there is no camera, or the board was not seen."""
    camera = view.session.dataset.camera
    return None if camera is None else camera.of(view.pose_id)


def reprojections(view: View) -> dict[str, ReprojectedView]:
    """Reprojection at each pose by the model on show; {} for the nominal robot and where no full poses are fitted."""
    if view.calibration is None or view.is_nominal:
        return {}
    return {one.view.pose: one for one in reprojected_views(view.calibration)}


def scan_facts(view: View, scan: Scan | None, drawn: int) -> str:
    """File, size, extent and conditions of the selected pose."""
    dataset, i = view.session.dataset, view.pose
    poses = dataset.poses
    rows: list[tuple[str, object]] = []
    alert = ""
    if view.pose_id in view.failures:
        alert = elements.alert(view.failures[view.pose_id])
    elif scan is not None:
        extent = np.ptp(scan.points_mm, axis=0) if len(scan.points_mm) else np.zeros(3)
        rows += [
            ("file", poses.scan_names[i]),
            ("points", f"{len(scan.points_mm):,} ({drawn:,} drawn)"),
            ("extent x · y · z", " · ".join(f"{e:.0f}" for e in extent) + " mm"),
        ]
        if scan.dropped:
            rows.append(("points without a value, left out", f"{scan.dropped:,}"))
    elif (seen := image_of(view)) is not None and dataset.camera is not None:
        image, fitted = dataset.image_path(i), reprojections(view).get(view.pose_id)
        rows += [("image", "not kept in the dataset's folder" if image is None else image.name)]
        rows += [("corners of the board", len(seen.corner))]
        if fitted is not None:
            noise = f"noise {dataset.camera.sigma_px:.3f}"
            rows.append(("reprojection", f"{fitted.rms_px:.3f} pixels per coordinate, RMS ({noise})"))
    elif dataset.scan_folder is not None:
        rows.append(("scan", "none: the point was measured (points.csv)"))
    joints = zip(dataset.robot.joints, poses.q[i], strict=True)
    rows.append(
        (
            "joints",
            " · ".join(
                numbers.signed(np.degrees(q), ".1f") + "°" if j.type == "revolute" else numbers.signed(q, ".1f") + " mm"
                for j, q in joints
            ),
        )
    )
    for name, values, unit in (
        ("payload", poses.payload_kg, "kg"),
        ("temperature", poses.temperature_c, "°C"),
        ("time", poses.time_s, "s"),
    ):
        if values is not None:
            rows.append((name, f"{values[i]:g} {unit}"))
    rows += [(name, column[i]) for name, column in poses.extra.by_name.items()]
    return alert + elements.facts(rows)


def pose_table(view: View) -> str:
    """Table of all poses with their state, the selected one marked."""
    poses, out = view.session.dataset.poses, view.session.uncounted
    searched = view.session.dataset.scan_folder is not None  # else nothing is known of faces and searches
    fitted = reprojections(view)
    rows = []
    for i, (pose_id, role) in enumerate(zip(poses.ids, poses.role, strict=True)):
        search, found = view.session.searches.get(pose_id), corner_of(view, i)
        known = found is not None and found[1] is not None
        sigma = numbers.length(float(np.sqrt(np.trace(found[1])))) if known else "–"  # type: ignore[index,arg-type]
        row: list[object] = [
            elements.named_swatch(LEFT_OUT if pose_id in out else role_colour(str(role)), pose_id),
            corner_state(view, i),
            sigma,
        ]
        if searched:
            corner = None if search is None else search.corner
            row.append("–" if corner is None else numbers.length(max(face.rms_mm for face in corner.faces)))
            row.append("–" if search is None else f"{search.seconds:.2f}")
        if fitted:
            row.append(f"{fitted[pose_id].rms_px:.3f}" if pose_id in fitted else "–")
        rows.append(row)
    return elements.table(
        (
            "pose",
            "corner" if searched else "point",
            "sigma, 3D",
            *(("worst rms", "search, s") if searched else ()),
            *(("reprojection, px",) if fitted else ()),
        ),
        rows,
        left=2,
        mark=view.pose,
        height="max(240px, calc(100vh - 400px))",
        asks=[elements.asking("pose", pose_id) for pose_id in poses.ids],
    )


def corner_state(view: View, pose: int) -> elements.Html | str:
    """State of a pose's corner in a word or two."""
    if view.session.dataset.poses.ids[pose] in view.session.uncounted:
        return elements.named_swatch(LEFT_OUT, "left out")
    search = view.session.searches.get(view.session.dataset.poses.ids[pose])
    if search is not None and search.failure:
        return elements.named_swatch(FAILED, "failed")
    if search is not None and search.corner is not None:
        doubts = len(search.corner.quality.doubts())
        return elements.named_swatch(DOUBT, numbers.count(doubts, "doubt")) if doubts else "found"
    if corner_of(view, pose) is not None:
        return "measured" if search is None else "found"
    return "waiting" if view.session.dataset.scan_path(pose) is not None else "none"
