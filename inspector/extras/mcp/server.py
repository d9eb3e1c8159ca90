"""The server of `inspector mcp`: each call of a tool runs one command in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from functools import wraps
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any

import anyio
from mcp.server.mcpserver import MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.tools import Tool
from mcp.types import ToolAnnotations

from calib.errors import CalibError
from inspector.extras.mcp.options import McpOptions
from inspector.extras.mcp.roots import Roots
from inspector.extras.mcp.tools import JSON_KEYS, CallError, CommandTool, command_tools

NAME = "robot-calibration-inspector"
SKILL = "inspector://skill"  # address of the guide as a resource
MOST_CHARACTERS = 60_000  # of one answer; an agent reads no more at a time
BAD = 2  # exit code of bad input
_READS = frozenset({"corners", "redundancy", "effects", "follow", "repeat", "watch", "check", "fleet"})
_ISOLATED = ("-P",)  # what lies in the working folder is data, and no module
_SAID = "inspector: "  # begins what a command says beside its result

Ended = subprocess.CompletedProcess[bytes]


@dataclass(frozen=True)
class Toolbox:
    """The tools, what they may touch, and how long a call may take."""

    roots: Roots
    timeout_s: float
    allow_code: bool = False
    tools: dict[str, CommandTool] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tools", command_tools(allow_code=self.allow_code))

    def functions(self) -> list[Tool]:
        """Every command as a typed function."""
        return [
            _tool(self._function(tool), tool.description, reads=tool.name in _READS) for tool in self.tools.values()
        ]

    def _function(self, tool: CommandTool) -> Callable[..., Awaitable[str]]:
        async def run(**given: Any) -> str:
            words, wanted = tool.words(given, self.roots), given.get(JSON_KEYS)
            if wanted is None:
                return _text(await self._run(words))
            return _parts(await self._run([words[0], "--json", *words[1:]]), wanted)

        run.__name__ = tool.name
        run.__signature__ = tool.signature()  # type: ignore[attr-defined]
        return run

    async def _run(self, words: list[str]) -> Ended:
        """A command that has ended. Raises CallError where it takes longer than a call may."""
        roots = json.dumps([*map(str, self.roots.folders)])
        started = [sys.executable, *_ISOLATED, "-m", "inspector.extras.mcp.confined", roots, *words]
        with tempfile.TemporaryDirectory(prefix="call-") as own, anyio.move_on_after(self.timeout_s):
            return await anyio.run_process(
                started, check=False, cwd=self.roots.folders[0], env=os.environ | {"TMPDIR": own}
            )
        raise CallError(f"{words[0]}: not done after {self.timeout_s:g} s, and ended (mcp --timeout-s)")


def server_of(toolbox: Toolbox) -> MCPServer[None]:
    """Server of the tools, with the guide as its instructions and as a resource."""
    server: MCPServer[None] = MCPServer(
        NAME,
        title="Robot calibration inspector",
        instructions=skill().partition("---\n\n")[2],
        version=version(NAME),
        tools=toolbox.functions(),
        log_level="ERROR",
    )
    server.resource(SKILL, name="skill", title="Find out why a robot arm is off", mime_type="text/markdown")(skill)
    return server


def skill() -> str:
    """The guide for an agent: which tool when, and what may be claimed."""
    return resources.files("inspector.extras.mcp").joinpath("skill.md").read_text(encoding="utf-8")


def run_mcp(options: McpOptions) -> int:
    """Serve the tools on stdin and stdout until the client ends it."""
    roots = Roots.of(options.root or [Path()])
    server_of(Toolbox(roots, options.timeout_s, options.allow_code)).run("stdio")
    return 0


def _tool(function: Callable[..., Awaitable[Any]], description: str, *, reads: bool) -> Tool:
    """Tool of a function, which takes no other arguments, and answers with the one line of what is refused."""

    @wraps(function)
    async def call(**given: object) -> Any:
        try:
            return await function(**given)
        except CalibError as error:
            raise ToolError(str(error)) from None

    hints = ToolAnnotations(read_only_hint=reads, open_world_hint=False)
    made = Tool.from_function(call, description=description, annotations=hints, structured_output=False)
    arguments = made.fn_metadata.arg_model
    arguments.model_config["extra"] = "forbid"
    arguments.model_rebuild(force=True)
    made.parameters = arguments.model_json_schema()
    return made


def _cut(text: str) -> str:
    """Text as long as an agent reads."""
    if len(text) <= MOST_CHARACTERS:
        return text
    left = len(text) - MOST_CHARACTERS
    return f"{text[:MOST_CHARACTERS]}\n... {left} more characters: ask for parts by {JSON_KEYS}"


def _text(ended: Ended) -> str:
    """What a command says. Raises CallError where its input was bad."""
    out, err = (stream.decode("utf-8", "replace").strip() for stream in (ended.stdout, ended.stderr))
    # Progress that overwrites itself is for a terminal.
    err = "\n".join(line for line in err.splitlines() if line.startswith(_SAID))
    if ended.returncode == BAD or ended.returncode < 0:
        raise CallError(err.removeprefix(_SAID) or out or f"ended by signal {-ended.returncode}")
    verdict = "" if ended.returncode == 0 else 'exit code 1: the answer is "not good enough"\n\n'
    return _cut("\n\n".join(part for part in (verdict + out, err) if part))


def _parts(ended: Ended, wanted: list[str]) -> str:
    """Parts of a command's JSON document; where no key is asked for, its keys."""
    if ended.returncode not in (0, 1):
        return _text(ended)
    document = json.loads(ended.stdout)
    if not wanted:
        return _cut("keys: " + ", ".join(document))
    missing = [key for key in wanted if key not in document]
    if missing:
        raise CallError(f"no key {missing[0]!r} in the document; there are {', '.join(document)}")
    return _cut(json.dumps({key: document[key] for key in wanted}, ensure_ascii=False))
