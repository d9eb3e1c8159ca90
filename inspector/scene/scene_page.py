"""The 3D view of a fitted model as a web page of its own, which can be turned and zoomed: for reports and notebooks."""

from __future__ import annotations

import base64
import hashlib
import html
import re
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
_SCRIPT = re.compile(r"<script[^>]*>(.*?)</script>", re.DOTALL)
NO_SCRIPTS = "This view of the arm needs a browser that runs scripts."


@dataclass(frozen=True)
class Scene3d:
    """A 3D view as a page of its own, which a report embeds and a notebook shows in a cell's output."""

    page: str  # HTML document, about 0.9 MB, that loads nothing from elsewhere

    @property
    def frame(self) -> str:
        """HTML element that shows the view within another page; a sentence where scripts do not run."""
        document = html.escape(self.page, quote=True)
        style = f"width:100%;height:{HEIGHT_PX}px;border:1px solid rgba(128,128,128,.4)"
        return (
            f'<iframe sandbox="allow-scripts" loading="lazy" title="The arm in 3D" style="{style}" srcdoc="{document}">'
            f"</iframe><noscript>{NO_SCRIPTS}</noscript>"
        )

    @property
    def policy(self) -> str:
        """Directives of a Content-Security-Policy that let the scripts of this view run by their hashes, no others."""
        digests = (hashlib.sha256(script.encode()).digest() for script in _SCRIPT.findall(self.page))
        hashes = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
        return (
            f"script-src {hashes} 'strict-dynamic' 'wasm-unsafe-eval'; worker-src blob:; img-src data: blob:; "
            "font-src data:; connect-src data: blob:"
        )

    def _repr_html_(self) -> str:
        return self.frame

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
    return scene_of(session)


def scene_of(session: Session) -> Scene3d:
    """3D view of a session's latest model at the reference pose."""
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
        return Scene3d(server.scene.as_html())
    finally:
        server.stop()
