"""The tool is dragged in the 3D view, and the page says how far the arm as delivered is off there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import viser
import viser.transforms

from inspector.app.app import App
from inspector.panels.review import TRY_PLACE
from inspector.scene.draw_place import CANNOT
from inspector.scene.scene_view import ROOT, sight_of
from tests.support.app import IDLE_S, shows
from tests.support.browser import close_notices, node_drawn, says
from tests.support.wire_client import WireClient

CONTROL = f"{ROOT}/place/control"
OFF_BY = "As delivered the arm is off by"


def drag(page: WireClient, by_m: tuple[float, float, float], *, release: bool = False) -> None:
    """Drag the control from where it was first put, as a page does."""
    node = page.scene[CONTROL]
    position = (np.asarray(node["position"], dtype=float) + by_m).tolist()
    wxyz = [float(value) for value in node["wxyz"]]
    page.send(type="TransformControlsUpdateMessage", name=CONTROL, wxyz=wxyz, position=position, owner="")
    if release:
        page.send(type="TransformControlsDragEndMessage", name=CONTROL, owner="")


def error_mm(app: App) -> float:
    """Length of the error on show, mm; nan where there is none."""
    place = app.place.place
    return float("nan") if place is None or place.error is None else float(place.error.length_mm[0])


@pytest.mark.slow
def test_the_error_is_read_where_the_tool_is_dragged(app: App, page: WireClient) -> None:
    page.wait(lambda p: p.props(TRY_PLACE)["visible"])
    assert CONTROL not in page.scene
    page.set(TRY_PLACE, True)
    shows(page, OFF_BY, "All joints are within the ranges")
    here_mm = error_mm(app)
    drag(page, (0.0, 0.0, 0.02))
    page.wait(lambda _: error_mm(app) not in (here_mm, float("nan")))
    page.wait(lambda p: f"{ROOT}/place/error" in p.scene)
    drag(page, (9.0, 0.0, 0.0), release=True)
    shows(page, "This place " + CANNOT)
    page.wait(lambda p: f"{ROOT}/place/error" not in p.scene)
    drag(page, (float("nan"), 0.0, 0.0))  # no page of ours sends that
    page.trigger("Next pose")  # begins anew at its tool
    second = app.state.session.dataset.poses.ids[1]
    page.wait(lambda _: (place := app.place.place) is not None and place.like == second and place.reached)
    shows(page, OFF_BY)
    page.set(TRY_PLACE, False)
    page.wait(lambda p: CONTROL not in p.scene and OFF_BY not in p.text())
    assert app.worker.wait_idle(IDLE_S)
    assert app.place.place is None


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.browser
def test_a_hand_drags_the_tool(app: App, page: Any) -> None:
    says(page, TRY_PLACE)
    page.get_by_label(TRY_PLACE).check()
    says(page, OFF_BY)
    node_drawn(page, CONTROL)
    close_notices(page)
    before = app.place.place
    assert before is not None
    clients = app.server.get_clients()
    sight = sight_of(clients[max(clients)].camera)  # the page's, which came last
    with WireClient(app.server.get_port()) as wire:
        node, root = wire.scene[CONTROL], wire.scene[ROOT]
    size = float(node["props"]["scale"])
    turn = np.asarray(viser.transforms.SO3(np.asarray(node["wxyz"])).as_matrix())
    middle = np.asarray(root["position"], dtype=float) + np.asarray(node["position"], dtype=float)
    box = page.locator("canvas").first.bounding_box()
    reach = [sight.on_screen(middle + np.outer([0.8 * size, 0.5 * size], axis)) for axis in turn.T]
    ends = max(reach, key=lambda two: float(np.linalg.norm(two[1] - two[0])))  # not the one that points at the eye
    start, end = ends * [box["width"], box["height"]] + [box["x"], box["y"]]
    page.mouse.move(*(start - 3.0))
    page.mouse.move(*start)
    page.wait_for_timeout(1000)  # until the arrow under the pointer is lit, some frames on
    page.mouse.down()
    page.mouse.move(*end, steps=5)
    page.mouse.up()
    with WireClient(app.server.get_port()) as wire:
        wire.wait(lambda _: app.place.place is not before, 20.0)
    assert app.worker.wait_idle(IDLE_S)
    assert app.place.place is not None
    assert not np.allclose(app.place.place.q, before.q)
    page.get_by_label(TRY_PLACE).uncheck()
    page.get_by_text(OFF_BY).wait_for(state="detached")
