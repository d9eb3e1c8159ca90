"""A page imports the user's own data: by drop, by the file dialog, corrected, refused, remembered; never unasked."""

from __future__ import annotations

import base64
import io
import json
import os
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.dataset.files.folder import load_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.robot_formats.chain.five_parameters import chain_of
from calib.robot_formats.urdf.text import plain_urdf
from calib.simulation.simulate import simulate_dataset
from inspector.app.app import App
from inspector.app.serving import serving
from inspector.panels.downloads import TARGETS
from inspector.panels.your_data import OPEN, OWN_DATA
from inspector.server.viser_server import url_of
from inspector.session.session_file import session_text
from tests.support.app import IDLE_S, idle, plain, shows, without_reflections
from tests.support.browser import MS, open_page, says
from tests.support.commands import printed
from tests.support.hidden_dataset import write_hidden
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow

EVIL = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def given() -> dict[str, bytes]:
    """A URDF, joints in degrees with joint 3 counted the other way, points in metres."""
    robot = builtin_robot("rb5")
    dataset = simulate_dataset(robot, rng=2, poses=40, noise_mm=0.02).dataset
    q = np.degrees(dataset.poses.q) * [1, 1, -1, 1, 1, 1]
    joints = ["Nr;" + ";".join(f"A{k}" for k in range(1, 7))]
    joints += [f"{i};" + ";".join(f"{v:.6f}".replace(".", ",") for v in row) for i, row in enumerate(q)]
    points = ["id,X,Y,Z"]
    points += [f"{i}," + ",".join(f"{v:.7f}" for v in row) for i, row in enumerate(1e-3 * dataset.points.xyz_mm)]
    return {
        "arm.urdf": plain_urdf(chain_of(robot)).encode(),
        "achsen.csv": "\n".join(joints).encode(),
        "tracker.csv": "\n".join(points).encode(),
    }


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_hidden(tmp_path_factory.mktemp("served") / "hidden")


@pytest.fixture
def app(served: Path, tmp_path: Path) -> Iterator[App]:
    with serving(served, port=0, data=tmp_path / "data") as running:
        without_reflections(running)
        assert running.worker.wait_idle(IDLE_S)
        yield running


def packed(files: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return out.getvalue()


def send(page: WireClient, name: str, content: bytes, source: str = OWN_DATA) -> None:
    """Upload a file as viser's page does."""
    page.upload(source, name, content)


def open_button(page: WireClient) -> bool:
    """Whether what is there can be imported."""
    return page.has(OPEN) and not page.props(OPEN)["disabled"]


def test_targets_that_a_page_brings_come_back_as_the_command_corrects_them(
    app: App, served: Path, tmp_path: Path
) -> None:
    """A table of joint targets, one of them out of reach of any correction; and what is no table."""
    rows = (served / "poses.csv").read_text().splitlines()
    given = tmp_path / "targets.csv"
    given.write_text("\n".join(rows[:6]) + "\n")
    model = app.state.now.session.calibration
    assert model is not None
    model.fitted_model.save(model_json := tmp_path / "model.json")
    printed("correct", served, "--model", model_json, "--joints", given, "--out", tmp_path / "out.csv", code=1)
    with WireClient(app.server.get_port()) as page:
        send(page, "targets.csv", given.read_bytes(), TARGETS)
        page.wait(lambda p: "corrected_targets.csv" in p.downloads)
        assert page.downloads["corrected_targets.csv"] == (tmp_path / "out.csv").read_bytes()
        shows(page, "of 5 (", "largest change of a joint", "not reached")
        send(page, "mine.csv", b"a,b\n1,2\n", TARGETS)
        shows(page, "mine.csv: line 1: missing column q1_deg")
        send(page, "photo.png", b"PNG", TARGETS)
        shows(page, "photo.png: is no file of targets")
        assert not list((tmp_path / "data").rglob("*.csv"))


def test_a_zip_becomes_a_dataset_that_is_open_listed_and_found_again(
    app: App, given: dict[str, bytes], tmp_path: Path, served: Path
) -> None:
    with WireClient(app.server.get_port()) as page, WireClient(app.server.get_port()) as other:
        send(page, "my cell.zip", packed(given))
        page.wait(open_button)
        said = plain(page)
        for part in ("achsen.csv", "joint 3, deg, other way round", "x, m", "the error falls from"):
            assert part in said
        assert not other.has(OPEN)  # the window is the page's own
        page.wait(lambda p: p.value("Name") == "my_cell")  # the fields follow the button one by one
        assert not (tmp_path / "data" / "my_cell").exists()
        options = page.props("Nr")["options"]
        assert options[:3] == ["pose", "kept as it is", "left out"]
        assert {"approach6", "payload_kg", "setup"} < set(options)
        page.set("A6", "approach6")
        page.wait(lambda p: p.value("A6") == "approach6" and "joint 3, deg, other way round" in plain(p))
        assert page.value("Nr") == "pose"
        page.set("A6", "joint 6, deg")
        page.wait(open_button)
        page.set("Name", "cell 7")
        page.click(OPEN)
        page.wait(lambda p: p.value("Dataset") == "cell 7")
        page.wait(lambda p: not p.has(OPEN))
        other.wait(lambda p: "cell 7" in p.props("Dataset")["options"])
    idle(app)
    assert app.state.session.diagnosis is not None  # it opens at its verdict
    assert load_dataset(tmp_path / "data" / "cell 7").name == "cell 7"
    assert [path.name for path in (tmp_path / "data").iterdir() if not path.name.startswith(".")] == ["cell 7"]
    app.close()
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["cell 7"]
    with (
        serving(served, port=0, data=tmp_path / "data") as again,
        WireClient(again.server.get_port()) as page,
    ):
        assert set(page.props("Dataset")["options"]) == {"hidden", "cell 7"}


@pytest.mark.thorough
def test_what_is_no_data_is_told_to_the_page_that_sent_it(app: App, tmp_path: Path) -> None:
    with WireClient(app.server.get_port()) as page, WireClient(app.server.get_port()) as other:
        send(page, "bad.zip", b"PK no zip")
        page.wait(lambda p: any("bad.zip" in n["props"]["body"] for n in p.notifications))
        send(page, "evil.zip", packed({"../../evil.csv": b"1"}))
        page.wait(lambda p: any("leads out of the folder" in n["props"]["body"] for n in p.notifications))
        assert other.notifications == []
        assert not page.has(OPEN)
    assert not list(tmp_path.rglob("evil*"))


@pytest.mark.thorough
def test_hostile_names_and_values_stay_text_and_change_nothing(app: App, tmp_path: Path) -> None:
    header = f"{EVIL},q1,q2,q3,q4,q5,q6,x,y,z"
    rows = np.random.default_rng(0).uniform(-2, 2, (30, 9))
    lines = [header, *(f"{EVIL}{i}," + ",".join(map(str, row)) for i, row in enumerate(rows))]
    with WireClient(app.server.get_port()) as page:
        send(page, "table of joints.csv", "\n".join(lines).encode(), source="Pose")  # not the button
        send(page, f"{EVIL}.csv", "\n".join(lines).encode())
        page.wait(lambda p: p.has(OPEN))
        shows(page, "no robot is chosen")
        assert "<img" not in page.text()
        for label in ("Robot", "q1", "Name", OPEN):
            for value in ("../../etc/passwd", 7, None, [], {"a": 1}, True, "x" * 5000):
                page.send(type="GuiUpdateMessage", uuid=page.find(label), updates={"value": value})
            page.send(type="GuiUpdateMessage", uuid=page.find(label), updates={"disabled": False, "visible": True})
        page.click(OPEN)
        idle(app)
        page.vanish()
    end = time.monotonic() + 10.0
    # Until the server sees that it is gone; what it deletes may vanish while it is walked.
    while any(files for _, _, files in os.walk(tmp_path / "data")):
        assert time.monotonic() < end
        time.sleep(0.05)


def without(robot_pose: str, app: App) -> str:
    """Text of a session in which a pose is left out, as *Take away* writes it; the page then has all poses again."""
    app.leave_out(robot_pose, True)
    idle(app)
    text = session_text(app.state.session, beside=Path("anywhere"))
    app.leave_out(robot_pose, False)
    idle(app)
    return text


@pytest.mark.thorough
def test_a_session_whose_dataset_is_not_there_says_which_it_needs(app: App, given: dict[str, bytes]) -> None:
    document = json.loads(session_text(app.state.session, beside=Path("anywhere")))
    document["dataset"] = {"name": "cell 9", "folder": "../there/nine", "files": {"dataset.toml": "0"}}
    text = json.dumps(document).encode()
    needed = ("session on the dataset 'cell 9' (folder 'nine')", "drop that dataset's folder or zip")
    with WireClient(app.server.get_port()) as page:
        send(page, "session.json", text)
        page.wait(lambda p: any(all(part in n["props"]["body"] for part in needed) for n in p.notifications))
        assert not page.has(OPEN)
        send(page, "torn.json", text[: len(text) // 2])
        page.wait(lambda p: any("torn.json" in n["props"]["body"] for n in p.notifications))
        send(page, "log.zip", packed(given | {"session.json": text}))
        page.wait(open_button)
        shows(page, *needed)
    assert app.state.session.calibration is not None


def test_without_a_place_for_data_the_page_says_how_to_start_it(served: Path, given: dict[str, bytes]) -> None:
    with serving(served, port=0) as app, WireClient(app.server.get_port()) as page:
        send(page, "log.zip", packed(given))  # nothing takes it
        page.click(OWN_DATA)
        shows(page, "inspector serve PATH --data my_data")
        assert not page.has(OPEN)
        page.click("Close")
        page.wait(lambda p: not p.has("Close"))


# ---- in a real browser ----------------------------------------------------------------------------------------------

DROP = """(files) => {
  const transfer = new DataTransfer();
  for (const [name, text] of files)
    transfer.items.add(new File([Uint8Array.from(atob(text), c => c.charCodeAt(0))], name));
  const on = document.querySelector("canvas");
  const how = { dataTransfer: transfer, bubbles: true, cancelable: true };
  const send = kind => on.dispatchEvent(new DragEvent(kind, how));
  send("dragenter");
  window.__zone = getComputedStyle(document.getElementById("inspector-drop")).display;
  send("dragover");
  send("drop");
}"""


@pytest.mark.browser
@pytest.mark.thorough
def test_in_a_browser_by_drop_and_by_the_file_dialog(
    chromium: Any, app: App, given: dict[str, bytes], tmp_path: Path
) -> None:
    files = [[name, base64.b64encode(content).decode()] for name, content in given.items()]
    with open_page(chromium, url_of(app.server), 900, 650) as page:
        page.evaluate(DROP, files)
        assert page.evaluate("() => window.__zone") == "flex"
        says(page, "joint 3, deg, other way round")
        assert page.locator("#inspector-drop").is_hidden()
        page.get_by_role("button", name=OPEN).click()
        page.get_by_role("button", name=OPEN).wait_for(state="detached", timeout=MS)
        idle(app)
        assert app.state.name == "achsen"
        for name, content in given.items():
            (tmp_path / name).write_bytes(content)
        with page.expect_file_chooser() as chooser:
            page.get_by_role("button", name=OWN_DATA).click()
        assert chooser.value.is_multiple()
        chooser.value.set_files([tmp_path / name for name in given])
        says(page, "joint 3, deg, other way round")


@pytest.mark.browser
@pytest.mark.thorough
def test_in_a_browser_a_dropped_session_opens(chromium: Any, app: App) -> None:
    text = base64.b64encode(without("p05", app).encode()).decode()
    with open_page(chromium, url_of(app.server), 900, 650) as page:
        page.evaluate(DROP, [["session.json", text]])
        says(page, "left out of these")
        idle(app)
        assert app.state.session.uncounted == {"p05"}
