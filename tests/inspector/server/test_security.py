"""Closed doors of the whole page: every name stays text, a hostile client changes nothing, nothing is written unasked.

The server's own doors (address, origins, tunnel, values of a widget) are tried in test_server.py, session files in
test_session_file.py.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from calib.dataset.files.folder import load_dataset, write_dataset
from calib.errors import DatasetError
from inspector.app.app import App
from inspector.cli.parser import main
from inspector.panels.downloads import ITEMS, OWN_FILE
from tests.support.app import idle, idle_app
from tests.support.hidden_dataset import HIDDEN, write_hidden
from tests.support.wire_client import WireClient

EVIL = "<img src=x onerror=alert(1)>"

OWN = f'''
import numpy as np
from calib.effects.base import Parameter


class Evil:
    """One more harmonic, with a name that would be markup."""

    name = "evil {EVIL}"
    parameters = (Parameter("c_rad", unit="{EVIL}", scale=1e-4, doc="{EVIL}"),)

    def apply(self, state, *, c_rad):
        return state.add_joint_error(1, c_rad * np.sin(2.0 * state.q_rad[:, 1]))
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset in which every name would be markup: its folder's, its own, the arm's, joints', poses', columns'."""
    below = tmp_path_factory.mktemp("security")
    dataset = load_dataset(write_hidden(below / "plain"))
    count = len(dataset.poses)
    joints = tuple(replace(joint, name=f"{EVIL}{i}") for i, joint in enumerate(dataset.robot.joints))
    extra = pd.DataFrame({f"column {EVIL}": [f"{EVIL} {i % 3}" for i in range(count)], f"n {EVIL}": np.arange(count)})
    poses = replace(
        dataset.poses,
        ids=tuple(f"{EVIL} {i}" for i in range(count)),
        setup=np.full(count, EVIL),
        extra=extra,
    )
    hostile = replace(
        dataset,
        name=EVIL,
        description=EVIL,
        robot=replace(dataset.robot, name=EVIL, joints=joints),
        poses=poses,
    )
    write_dataset(hostile, below / "served" / EVIL)
    (below / "own.py").write_text(OWN)
    return below


@pytest.fixture(scope="module")
def running(folder: Path) -> Iterator[App]:
    with idle_app(folder / "served", effects_file=folder / "own.py") as app:
        yield app


# ---- names ----------------------------------------------------------------------------------------------------------


def unescaped(page: WireClient) -> list[str]:
    """Widgets that are rendered as markup and hold the hostile name as it is."""
    with page._changed:
        shown = [m["props"] for m in page.gui.values()]
    found = []
    for props in shown:
        for key in ("content", "_markdown", "_plotly_json_str"):
            text = props.get(key) or ""
            if EVIL in text or EVIL.replace('"', '\\"') in text or "<img" in text.replace("\\u003c", "<"):
                found.append(f"{key}: {text[max(0, text.find('<img') - 80) :][:200]}")
    return found


@pytest.mark.slow
def test_no_name_becomes_markup_on_any_tab(app: App) -> None:
    view = app.state.now
    assert view.session.user_effects
    with WireClient(app.server.get_port()) as page:
        assert EVIL.replace("<", "&lt;").replace(">", "&gt;") in page.text()
        assert unescaped(page) == []
        for choice in ("Against", "Show", "Effect"):
            for option in page.props(choice)["options"]:
                page.set(choice, option)
                idle(app)
                assert unescaped(page) == [], (choice, option)
        app.add_effect(f"evil {EVIL}")
        idle(app)
        assert unescaped(page) == []
        app.find(True)
        idle(app)
        assert app.state.now.session.diagnosis is not None
        assert unescaped(page) == []
        app.panels.review.show_problem(EVIL)
        page.wait(lambda p: "&lt;img" in p.text())
        assert unescaped(page) == []


# ---- files ----------------------------------------------------------------------------------------------------------

_watched: list[list[str]] = []


def _listen(event: str, arguments: tuple[Any, ...]) -> None:
    if not _watched:
        return
    if event == "open":
        path, mode, flags = arguments
        writes = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT) if isinstance(flags, int) else 0
        if isinstance(path, str | bytes) and (writes or (mode and set(str(mode)) & set("wax+"))):
            _watched[-1].append(os.fsdecode(path))
    elif event in ("os.rename", "os.link", "os.symlink"):
        _watched[-1].append(os.fsdecode(arguments[1]))
    elif event in ("os.mkdir", "os.remove", "os.rmdir", "os.truncate", "os.chmod", "shutil.rmtree"):
        if isinstance(arguments[0], str | bytes | os.PathLike):
            _watched[-1].append(os.fsdecode(arguments[0]))
    elif event in ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn"):
        _watched[-1].append(f"program: {arguments[0]}")


@contextmanager
def written() -> Iterator[list[str]]:
    """Every path that this process writes, makes, moves or removes meanwhile; Python's own caches are left out."""
    if not hasattr(sys, "_inspector_listens"):
        sys.addaudithook(_listen)  # stays for good, and is silent outside
        sys._inspector_listens = True  # type: ignore[attr-defined]
    paths: list[str] = []
    _watched.append(paths)
    try:
        yield paths
    finally:
        _watched.pop()
        paths[:] = [p for p in paths if "__pycache__" not in p and p != os.devnull]


@pytest.mark.thorough
def test_the_page_writes_nothing_whatever_is_pressed(app: App, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CHROMIUM", str(folder / "no_browser"))  # one would print from a temporary folder
    with written() as paths:
        (folder / "seen").touch()  # the watch itself works
    assert paths == [str(folder / "seen")]
    rng = np.random.default_rng(0)
    garbage = [True, 9999, -1, "../../../etc/passwd", EVIL, None, [], {"value": 1}, float("nan"), "x" * 5000]
    with written() as paths, WireClient(app.server.get_port()) as page:
        for uuid in list(page.gui):
            for value in rng.permutation(np.array(garbage, dtype=object))[:4]:
                page.send(type="GuiUpdateMessage", uuid=uuid, updates={"value": value})
        made = [name for name in ITEMS if name != OWN_FILE]  # no URDF was kept here
        idle(app)  # a button pressed among the garbage makes its file too
        for name in made:
            page.downloads.clear()
            page.click(name)
            page.wait(lambda p: p.downloads, 30.0)
        idle(app)
    assert paths == []


@pytest.mark.slow
def test_no_message_makes_the_server_take_or_give_a_file(app: App, folder: Path) -> None:
    secret = folder / "secret.txt"
    secret.write_text("secret")
    with written() as paths, WireClient(app.server.get_port()) as page:
        page.send(
            type="FileTransferStartUpload", source_component_uuid=next(iter(page.gui)), transfer_uuid="u",
            filename="../../evil.sh", mime_type="text/plain", part_count=1, size_bytes=4,
        )  # fmt: skip
        page.send(
            type="FileTransferPart", source_component_uuid=next(iter(page.gui)), transfer_uuid="u", part_index=0,
            content=b"evil",
        )  # fmt: skip
        page.click("Redundancy (CSV)")
        page.wait(lambda p: p.downloads, 30.0)
        assert all(b"secret" not in content for content in page.downloads.values())
        assert not any("/" in name or ".." in name for name in page.downloads)
    assert paths == []


@pytest.mark.thorough
def test_commands_write_where_they_are_told_and_nowhere_else(folder: Path, tmp_path: Path) -> None:
    data, out = str(folder / "served" / EVIL), tmp_path / "out"
    commands = [
        ["calibrate", data, "--out", str(out / "robot.toml"), "--residuals", str(out / "r.csv"),
         "--session", str(out / "s.json"), "--add", HIDDEN],
        ["redundancy", data, "--out", str(out / "p.csv")],
        ["report", data, "--out", str(out / "report.html")],
        ["correct", data, "--joints", f"{data}/poses.csv", "--out", str(out / "corrected.csv")],
    ]  # fmt: skip
    for command in commands:
        with written() as paths:
            assert main(command) in (0, 1)
        assert paths, command
        assert all(Path(path).is_relative_to(out) for path in paths), (command, paths)
    for command in (["diagnose", data], ["check", data], ["effects"]):
        with written() as paths:
            assert main(command) in (0, 1)
        assert paths == [], command
    assert {path.suffix for path in out.iterdir()} == {".toml", ".csv", ".json", ".html"}


@pytest.mark.parametrize("key", ["robot", "poses", "points", "scans"])
@pytest.mark.parametrize("path", ["../own.py", "/etc/passwd", "a/../../x"])
def test_a_dataset_names_no_file_outside_its_folder(folder: Path, tmp_path: Path, key: str, path: str) -> None:
    there = tmp_path / "cell"
    write_dataset(load_dataset(folder / "plain" / "hidden"), there)
    text = (there / "dataset.toml").read_text()
    kept = "\n".join(line for line in text.splitlines() if not line.startswith(f"{key} ="))
    (there / "dataset.toml").write_text(kept.replace("format = 1", f'format = 1\n{key} = "{path}"'))
    with pytest.raises(DatasetError, match="not below"):
        load_dataset(there)
