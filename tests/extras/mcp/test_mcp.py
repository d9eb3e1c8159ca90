"""The commands as tools of the Model Context Protocol, asked by the protocol's own client."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcp import Client, StdioServerParameters, types

from inspector.cli.commands import commands
from inspector.extras.mcp.roots import RootError, Roots
from inspector.extras.mcp.server import SKILL, Toolbox, server_of
from inspector.extras.mcp.tools import NOT_OFFERED, CallError, command_tools
from tests.support.hidden_dataset import write_hidden

pytestmark = pytest.mark.slow  # each call is a process


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with one dataset, whose arm has an effect that the model lacks."""
    return write_hidden(tmp_path_factory.mktemp("agent")).parent


@pytest.fixture(scope="module")
def toolbox(root: Path) -> Toolbox:
    return Toolbox(Roots.of([root]), timeout_s=120.0)


def dataset_in(root: Path) -> str:
    return next(path.parent.name for path in root.rglob("dataset.toml"))


def answers(toolbox: Toolbox, *calls: tuple[str, Mapping[str, Any]]) -> list[types.CallToolResult]:
    """Answers of several calls by a client of the server."""

    async def ask() -> list[types.CallToolResult]:
        async with Client(server_of(toolbox)) as client:
            return [await client.call_tool(name, dict(arguments)) for name, arguments in calls]

    return asyncio.run(ask())


def text_of(answer: types.CallToolResult) -> str:
    return "\n".join(one.text for one in answer.content if isinstance(one, types.TextContent))


def test_an_agent_on_stdin_and_stdout_gets_from_the_folder_to_the_cause(root: Path) -> None:
    server = StdioServerParameters(
        command=sys.executable, args=["-m", "inspector", "mcp", "--root", str(root)], env=dict(os.environ)
    )

    async def work() -> dict[str, Any]:
        async with Client(server) as client:
            tools = {tool.name: tool for tool in (await client.list_tools()).tools}
            guide = await client.read_resource(SKILL)
            assert "Claim none of its members" in guide.contents[0].text  # type: ignore[union-attr]
            keys = await client.call_tool("redundancy", {"path": dataset_in(root), "json_keys": []})
            assert "combinations" in text_of(keys)
            parts = await client.call_tool("diagnose", {"path": dataset_in(root), "json_keys": ["missing", "verdict"]})
            assert tools["diagnose"].annotations is not None
            found: dict[str, Any] = json.loads(text_of(parts))
            return found

    assert asyncio.run(work()) == {"missing": ["transmission_error"], "verdict": "named"}


@pytest.mark.thorough
def test_what_is_bad_is_an_answer_and_the_server_lives(toolbox: Toolbox, root: Path) -> None:
    name = dataset_in(root)
    *bad, good = answers(
        toolbox,
        ("diagnose", {"path": "nowhere"}),
        ("diagnose", {"path": name, "no_such": 1}),
        ("diagnose", {}),
        ("diagnose", {"path": name, "residual": "nonsense"}),
        ("diagnose", {"path": name, "robust": "yes"}),
        ("diagnose", {"path": ["a", "b"]}),
        ("diagnose", {"path": name, "max_steps": True}),
        ("diagnose", {"path": name, "json_keys": ["no_such"]}),
        ("nonsense", {}),
        ("serve", {"path": name}),
        ("check", {"path": name, "max_test_rmse_mm": 1e-3}),
    )
    found = [text_of(one) for one in bad]
    assert all(one.is_error for one in bad)
    assert "Traceback" not in "".join(found)
    for said, part in zip(
        found,
        (
            "nowhere", "no_such\n  Extra inputs are not permitted", "path\n  Field required",
            "Input should be 'position', 'distance', 'pairs' or 'pose'", "robust\n  Input should be a valid boolean",
            "path\n  Input should be a valid string", "max_steps\n  Input should be a valid integer",
            "no key 'no_such'", "Unknown tool", "Unknown tool",
        ),
        strict=True,
    ):  # fmt: skip
        assert part in said
    assert not good.is_error  # the answer is no, which is no error
    assert text_of(good).startswith('exit code 1: the answer is "not good enough"')


def test_nothing_outside_the_roots_is_read_or_written(toolbox: Toolbox, root: Path, tmp_path: Path) -> None:
    name = dataset_in(root)
    outside = tmp_path / "outside"
    shutil.copytree(root / name, outside)
    (root / "link").symlink_to(outside)
    (root / "table").symlink_to(outside / "robot.toml")
    written = tmp_path / "model.json"
    calls = (
        ("diagnose", {"path": str(outside)}),
        ("diagnose", {"path": f"../{outside.name}"}),
        ("diagnose", {"path": "link"}),
        ("diagnose", {"path": name, "model_out": str(written)}),
        ("report", {"path": name, "out": "link/report.html"}),
        ("import", {"path": "new", "robot": str(outside / "robot.toml")}),
        ("convert", {"source": str(outside / "robot.toml"), "out": "robot.urdf"}),
        ("convert", {"source": f"{outside / 'run.bag'}#/../..{root}/x.toml", "out": "robot.urdf"}),
        ("simulate", {"path": "new", "robot": "table"}),
    )
    for answer in answers(toolbox, *calls):
        assert answer.is_error
        assert "is outside of what may be read and written here" in text_of(answer)
    assert not written.exists()
    assert not (outside / "report.html").exists()


def test_a_file_in_the_root_is_data_and_no_module(root: Path) -> None:
    trap = root / "trap"
    trap.mkdir()
    (trap / "numpy.py").write_text("raise SystemExit('run')")
    shutil.copytree(root / dataset_in(root), trap / "cell")
    (told,) = answers(Toolbox(Roots.of([trap]), timeout_s=120.0), ("redundancy", {"path": "cell"}))
    assert not told.is_error, text_of(told)
    shutil.rmtree(trap)


def test_what_takes_too_long_is_ended(root: Path) -> None:
    (told,) = answers(Toolbox(Roots.of([root]), timeout_s=0.05), ("diagnose", {"path": dataset_in(root)}))
    assert told.is_error
    assert "not done after 0.05 s" in text_of(told)


def schemas(*, allow_code: bool = False) -> dict[str, dict[str, Any]]:
    """Schema of each tool."""
    toolbox = Toolbox(Roots((Path("/").resolve(),)), 60.0, allow_code)
    return {tool.name: tool.input_schema for tool in asyncio.run(server_of(toolbox).list_tools())}


def test_every_command_is_a_tool_and_code_is_run_where_allowed_only() -> None:
    tools = schemas()
    assert set(tools) == {*commands()} - set(NOT_OFFERED)
    assert "effects_file" not in tools["diagnose"]["properties"]
    assert "effects_file" in schemas(allow_code=True)["diagnose"]["properties"]
    assert tools["report"]["required"] == ["out", "path"]
    for schema in tools.values():
        assert schema["additionalProperties"] is False
        assert all(one["description"] for one in schema["properties"].values())


@given(st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\0")), min_size=1, max_size=3))
def test_values_stay_values(names: list[str]) -> None:
    """Whatever text an argument holds, it reaches the command as that argument's value and never as an option."""
    tool = command_tools(allow_code=False)["diagnose"]
    words = tool.words({"path": "cell", "leave_out": names}, Roots((Path("/").resolve(),)))
    assert words == ["diagnose", *(f"--leave-out={name}" for name in names), "--", "cell"]


def test_a_root_that_is_no_folder_and_a_name_with_a_null_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RootError, match="is no folder"):
        Roots.of([tmp_path / "missing"])
    with pytest.raises(RootError, match="is no path"):
        Roots.of([tmp_path]).require("a\0b")


def test_a_xacro_is_refused_with_the_command_that_expands_it(tmp_path: Path) -> None:
    tools = command_tools(allow_code=True)
    for name, key in (("convert", "source"), ("plan", "path"), ("import", "robot")):
        with pytest.raises(CallError, match=r"`inspector convert arm.urdf.xacro arm.urdf` expands it"):
            tools[name].words({key: "arm.urdf.xacro"}, Roots.of([tmp_path]))
