"""Tab Scans: the scan of the selected pose, and the state of all of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
import plotly.graph_objects as go
import viser

from calib.plugins import load
from calib.rendering import numbers
from calib.scans.scan import Scan
from inspector.markup.model.comparison import roles_legend
from inspector.markup.parts import elements
from inspector.markup.parts.palette import DOUBT, FAILED, LEFT_OUT, role_colour
from inspector.panels.base import Actions, FollowsModel, hidden_plot
from inspector.plugins import PoseView, contributions
from inspector.session.view import View, corner_of

NOTE = (
    "The selected scan in full, all others in few points, in the colour of their role. Look for scans that miss the "
    "jig, are noisy, or lie apart from the rest. A pose without a corner is left out of the fit."
)
NO_SCANS = "The points were measured (points.csv). The list gives the uncertainty of each."


class ShownPose(Protocol):
    """What a plug-in shows of the selected pose of a dataset that an instrument of its own measured."""

    @property
    def note(self) -> str:
        """What is shown, and what to look for."""

    @property
    def column(self) -> tuple[str, Mapping[str, str]] | None:
        """Title of a further column of the table of all poses, and its cells by pose."""

    def figure(self) -> tuple[go.Figure, float] | None:
        """Figure of the pose with its height over its width; None where there is none."""

    def facts(self) -> list[tuple[str, object]]:
        """Facts on what was measured at the pose; [] where nothing was."""


def shown_pose(view: View) -> ShownPose | None:
    """What a plug-in shows of the selected pose; None where none measured the dataset."""
    found = (load(kind.of_view)(view) for kind in contributions(PoseView))
    return next((each for each in found if each is not None), None)


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
        """Show what the model on show makes of what was measured, where a plug-in's instrument did."""
        if shown_pose(view) is not None:
            self.update_scan(view, None, 0)

    def update_scan(self, view: View, scan: Scan | None, drawn: int) -> None:
        """Show the selected scan's or image's facts; `drawn` is the number of its points in the scene."""
        self._show.visible = view.session.dataset.scan_folder is not None
        by_plugin = shown_pose(view)
        note = NO_SCANS if by_plugin is None else by_plugin.note
        self._note.content = elements.note(NOTE if self._show.visible else note)
        self._scan.content = elements.heading(f"Pose {view.pose_id}") + scan_facts(view, scan, drawn)
        self.update_image(view)
        self.update_list(view)

    def update_image(self, view: View) -> None:
        """Draw the selected pose as a plug-in does, where one measured it."""
        by_plugin = shown_pose(view)
        drawn = None if by_plugin is None else by_plugin.figure()
        self._image.visible = drawn is not None
        if drawn is not None:
            self._image.figure, self._image.aspect = drawn

    def update_list(self, view: View) -> None:
        """Refresh the table of all poses."""
        self._all.content = elements.heading("All poses") + roles_legend(view) + pose_table(view)


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
    elif (by_plugin := shown_pose(view)) is not None and (known := by_plugin.facts()):
        rows += known
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
    by_plugin = shown_pose(view)
    further = None if by_plugin is None else by_plugin.column
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
        if further is not None:
            row.append(further[1].get(pose_id, "–"))
        rows.append(row)
    return elements.table(
        (
            "pose",
            "corner" if searched else "point",
            "sigma, 3D",
            *(("worst rms", "search, s") if searched else ()),
            *(() if further is None else (further[0],)),
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
