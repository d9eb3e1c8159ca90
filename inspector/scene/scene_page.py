"""The 3D view of a fitted model as a web page of its own, which can be turned and zoomed: for reports and notebooks."""

from __future__ import annotations

import html
from dataclasses import dataclass, replace

from calib.calibration.result import Calibration
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.result import Diagnosis
from inspector.scene.camera import Camera
from inspector.scene.draw_model import ArmDrawing
from inspector.scene.draw_scan import draw_corners, fitting_ellipsoids
from inspector.scene.residual_arrows import ResidualArrows, fitting_arrows
from inspector.scene.scene_view import SceneView
from inspector.server.viser_server import start_server
from inspector.session.session import Session
from inspector.session.transitions import with_steps, with_versions
from inspector.session.view import View

VIEW = "Arm"
HEIGHT_PX = 480
NO_SCRIPTS = "This view of the arm needs a browser that runs scripts."


@dataclass(frozen=True)
class Scene3d:
    """A 3D view that a notebook shows in a cell's output."""

    page: str  # HTML document without anything from elsewhere

    def _repr_html_(self) -> str:
        return frame(self.page)

    def __repr__(self) -> str:
        return f"Scene3d({len(self.page) / 1e6:.1f} MB of HTML)"


def scene_3d(of: Diagnosis | Calibration) -> Scene3d:
    """3D view of an arm at its reference pose with the model's errors as arrows, over those of the model before.

    Raises CalibError where the arm cannot be placed.
    """
    if isinstance(of, Diagnosis):
        session = with_steps(Session(of.calibration.dataset), of.steps)
    else:
        session = with_steps(Session(of.dataset), (FitStep("model", (), of),))
    return Scene3d(scene_page(session))


def scene_page(session: Session) -> str:
    """HTML document, about 0.9 MB, with the 3D view of a session's latest model; it loads nothing from elsewhere."""
    session = with_versions(session, session)
    newest = session.versions[-1].name
    view = View(session, pose=session.dataset.poses.reference, chosen=newest, compared=frozenset({newest}))
    view = replace(view, arrows=fitting_arrows(view), factor=fitting_ellipsoids(view))
    server = start_server(port=0)  # viser writes pages of scenes that a server has; nobody connects to this one
    try:
        scene = SceneView(server)
        camera = Camera(scene, lambda layers: None)
        draw_corners(scene, view, lambda pose: None)
        arrows = ResidualArrows(scene, lambda pose: None)
        arrows.draw(view)
        ArmDrawing(scene, lambda joint: None).draw(view)
        camera.choose(VIEW)
        camera.at(view, {})
        return server.scene.as_html()
    finally:
        server.stop()


def frame(page: str, height_px: int = HEIGHT_PX) -> str:
    """HTML element that shows a document within another page; nothing but a sentence where scripts do not run."""
    document = html.escape(page, quote=True)
    style = f"width:100%;height:{height_px}px;border:1px solid rgba(128,128,128,.4)"
    return (
        f'<iframe sandbox="allow-scripts" loading="lazy" title="The arm in 3D" style="{style}" srcdoc="{document}">'
        f"</iframe><noscript>{NO_SCRIPTS}</noscript>"
    )
