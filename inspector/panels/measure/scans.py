"""Tab Scans: the scan of the selected pose, and the state of all of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
import plotly.graph_objects as go
import viser

from calib.plugins import load
from calib.rendering import numbers
from calib.rendering.blocks import Coloured, Facts, Paragraph, Table, Verdict, Words, pose
from calib.rendering.html import panel
from calib.scans.scan import Scan
from inspector.markup.legend import roles_legend
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
        failure = Verdict(view.failures.get(view.pose_id, ""), FAILED)
        facts = Facts(scan_facts(view, scan, drawn))
        self._scan.content = panel([Paragraph(f"Pose {view.pose_id}", heading=True), failure, facts])
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
        self._all.content = elements.heading("All poses") + roles_legend(view) + panel([pose_table(view)])


def scan_facts(view: View, scan: Scan | None, drawn: int) -> list[tuple[str, object]]:
    """File, size, extent and conditions of the selected pose."""
    dataset, i = view.session.dataset, view.pose
    poses = dataset.poses
    rows: list[tuple[str, object]] = []
    if view.pose_id in view.failures:
        pass  # nothing is known of a scan that could not be read
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
    turning = dataset.robot.is_revolute
    values = np.where(turning, np.degrees(poses.q[i]), poses.q[i])
    units = np.where(turning, "°", " mm")
    rows.append(("joints", " · ".join(f"{numbers.signed(q, '.1f')}{u}" for q, u in zip(values, units, strict=True))))
    for name, column, unit in (
        ("payload", poses.payload_kg, "kg"),
        ("temperature", poses.temperature_c, "°C"),
        ("time", poses.time_s, "s"),
    ):
        if column is not None:
            rows.append((name, f"{column[i]:g} {unit}"))
    return rows + [(name, further[i]) for name, further in poses.extra.by_name.items()]


def pose_table(view: View) -> Table:
    """Table of all poses with their state, the selected one marked."""
    poses, out = view.session.dataset.poses, view.session.uncounted
    searched = view.session.dataset.scan_folder is not None  # else nothing is known of faces and searches
    by_plugin = shown_pose(view)
    further = None if by_plugin is None else by_plugin.column
    rows = []
    for i, (pose_id, role) in enumerate(zip(poses.ids, poses.role, strict=True)):
        search, found = view.session.searches.get(pose_id), corner_of(view, i)
        covariance = None if found is None else found[1]
        sigma = "–" if covariance is None else numbers.length(float(np.sqrt(np.trace(covariance))))
        colour = LEFT_OUT if pose_id in out else role_colour(str(role))
        row: list[Words] = [Coloured(pose_id, colour), corner_state(view, i), sigma]
        if searched:
            corner = None if search is None else search.corner
            row.append("–" if corner is None else numbers.length(max(face.rms_mm for face in corner.faces)))
            row.append("–" if search is None else f"{search.seconds:.2f}")
        if further is not None:
            row.append(further[1].get(pose_id, "–"))
        rows.append(row)
    of_scans = ("corner", "sigma, 3D", "worst rms", "search, s") if searched else ("point", "sigma, 3D")
    return Table(
        ("pose", *of_scans, *(() if further is None else (further[0],))),
        rows,
        left=(0, 1),
        mark=view.pose,
        height="max(240px, calc(100vh - 400px))",
        rows_select=[pose(pose_id) for pose_id in poses.ids],
    )


def corner_state(view: View, pose: int) -> Words:
    """State of a pose's corner in a word or two."""
    if view.session.dataset.poses.ids[pose] in view.session.uncounted:
        return Coloured("left out", LEFT_OUT)
    search = view.session.searches.get(view.session.dataset.poses.ids[pose])
    if search is not None and search.failure:
        return Coloured("failed", FAILED)
    if search is not None and search.corner is not None:
        doubts = len(search.corner.quality.doubts())
        return Coloured(numbers.count(doubts, "doubt"), DOUBT) if doubts else "found"
    if corner_of(view, pose) is not None:
        return "measured" if search is None else "found"
    return "waiting" if view.session.dataset.scan_path(pose) is not None else "none"
