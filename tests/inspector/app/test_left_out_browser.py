"""In a real browser: a pose left out by its button, undone and redone by keys, also from a list that was used last."""

from __future__ import annotations

from typing import Any

import pytest

from inspector.app.app import App
from inspector.panels.review import LEAVE_OUT, TAKE_IN
from tests.support.app import idle
from tests.support.browser import MS, open_tab, says

pytestmark = [pytest.mark.browser, pytest.mark.thorough]
POSE = "p05"


def button(page: Any, name: str) -> Any:
    return page.get_by_role("button", name=name, exact=True)


def test_a_pose_is_left_out_by_its_button_and_said_everywhere(page: Any, app: App) -> None:
    open_tab(page, "Scans")
    page.locator(f'tr[data-value="{POSE}"]').first.click()
    says(page, "5 of 45, training")
    button(page, LEAVE_OUT).click()
    button(page, TAKE_IN).wait_for(timeout=MS)
    row = page.locator(f'tr[data-value="{POSE}"]').first
    row.get_by_text("left out").wait_for(timeout=MS)
    says(page, "no figure takes it")
    open_tab(page, "What is missing")
    says(page, f"− pose {POSE}: the error of the held-out test poses that count now is")
    idle(app)
    assert app.state.session.uncounted == {POSE}


def test_a_field_that_is_typed_into_keeps_the_keys_for_its_text(page: Any, app: App) -> None:
    page.evaluate("document.body.insertAdjacentHTML('beforeend', '<input id=typed>')")
    page.locator("#typed").fill("some text")
    page.locator("#typed").press("Control+z")
    page.wait_for_timeout(200)
    idle(app)
    assert app.state.session.uncounted == {POSE}
    page.evaluate("document.getElementById('typed').remove()")
