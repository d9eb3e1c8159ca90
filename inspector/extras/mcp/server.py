"""The server of `inspector mcp`: each call of a tool runs one command in a process of its own."""

from __future__ import annotations

import base64
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import anyio
from mcp import types
from mcp.server import Server
from mcp.server.stdio import stdio_server

from calib.errors import CalibError
from inspector.extras.mcp.options import McpOptions
from inspector.extras.mcp.roots import Roots
from inspector.extras.mcp.tools import FIGURE, JSON_KEYS, CommandTool, ToolError, command_tools

if TYPE_CHECKING:
    from mcp.server import ServerRequestContext

NAME = "robot-calibration-inspector"
SKILL = "inspector://skill"  # address of the guide as a resource
MOST_CHARACTERS = 60_000  # of one answer; an agent reads no more at a time
BAD = 2  # exit code of bad input
_READS = frozenset({"corners", "redundancy", "effects", "follow", "verify", "repeat", "watch", "check", "fleet"})

_ISOLATED = ("-P",)  # what lies in the working folder is data, and no module

_SAID = "inspector: "  # begins what a command says beside its result

Content = types.TextContent | types.ImageContent


@dataclass(frozen=True)
class Answer:
    """What a call answers with."""

    content: tuple[Content, ...]
    is_error: bool = False

    @classmethod
    def of_text(cls, text: str, *, is_error: bool = False) -> Answer:
        """Answer of text alone, cut where it is longer than an agent reads."""
        if len(text) > MOST_CHARACTERS:
            left = len(text) - MOST_CHARACTERS
            text = f"{text[:MOST_CHARACTERS]}\n... {left} more characters: ask for parts by {JSON_KEYS}"
        return cls((types.TextContent(type="text", text=text),), is_error)


@dataclass(frozen=True)
class Toolbox:
    """The tools, what they may touch, and how long a call may take."""

    roots: Roots
    timeout_s: float
    allow_code: bool = False
    tools: dict[str, CommandTool] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tools", command_tools(allow_code=self.allow_code))

    def listed(self) -> list[types.Tool]:
        """All tools with their schemas."""
        told = [
            types.Tool(
                name=tool.name,
                description=tool.description,
                input_schema=tool.schema(),
                annotations=types.ToolAnnotations(read_only_hint=name in _READS, open_world_hint=False),
            )
            for name, tool in self.tools.items()
        ]
        return [*told, _figure_tool()]

    async def call(self, name: str, given: Mapping[str, Any]) -> Answer:
        """Answer of a call; what is wrong with it, or with the data, is an answer, too."""
        try:
            if name == FIGURE:
                return await self._figure(given)
            tool = self.tools.get(name)
            if tool is None:
                raise ToolError(f"{name}: no such tool; there are {', '.join([*self.tools, FIGURE])}")
            wanted = _wanted_keys(tool, given)
            words = tool.words(given, self.roots)
            if wanted is None:
                return _text_answer(await self._run(words))
            return _json_answer(await self._run([words[0], "--json", *words[1:]]), wanted)
        except CalibError as error:
            return Answer.of_text(str(error), is_error=True)

    async def _run(self, words: list[str]) -> subprocess.CompletedProcess[bytes]:
        """A command that has ended. Raises ToolError where it takes longer than a call may."""
        with anyio.move_on_after(self.timeout_s):
            return await anyio.run_process(
                [sys.executable, *_ISOLATED, "-m", "inspector", *words], check=False, cwd=self.roots.folders[0]
            )
        raise ToolError(f"{words[0]}: not done after {self.timeout_s:g} s, and ended (mcp --timeout-s)")

    async def _figure(self, given: Mapping[str, Any]) -> Answer:
        """A figure of a diagnosis as a picture; without a name, the names of all."""
        name, asked = given.get("name"), {key: value for key, value in given.items() if key != "name"}
        tool = self.tools["figures"]
        if not name:
            return _text_answer(await self._run(tool.words(asked, self.roots)))
        with tempfile.TemporaryDirectory(prefix="figure-") as folder:
            words = tool.words(asked | {"name": [name]}, self.roots)
            out = [f"--out={folder}", "--png", "--json"]
            ended = await self._run([words[0], *out, *words[1:]])
            if ended.returncode:
                return _text_answer(ended)
            (told,) = json.loads(ended.stdout)["figures"]
            picture = base64.b64encode(Path(told["file"]).read_bytes()).decode("ascii")
        caption = types.TextContent(type="text", text=told["caption"])
        return Answer((types.ImageContent(type="image", data=picture, mime_type="image/png"), caption))


def skill() -> str:
    """The guide for an agent: which tool when, and what may be claimed."""
    return resources.files("inspector.extras.mcp").joinpath("skill.md").read_text(encoding="utf-8")


def server_of(toolbox: Toolbox) -> Server[Any]:
    """Server of the tools, with the guide as its instructions and as a resource."""

    async def list_tools(_: ServerRequestContext[Any], __: object) -> types.ListToolsResult:
        return types.ListToolsResult(tools=toolbox.listed())

    async def call_tool(_: ServerRequestContext[Any], asked: types.CallToolRequestParams) -> types.CallToolResult:
        answer = await toolbox.call(asked.name, asked.arguments or {})
        return types.CallToolResult(content=list(answer.content), is_error=answer.is_error)

    async def list_resources(_: ServerRequestContext[Any], __: object) -> types.ListResourcesResult:
        guide = types.Resource(
            uri=SKILL, name="skill", title="Find out why a robot arm is off", mime_type="text/markdown"
        )
        return types.ListResourcesResult(resources=[guide])

    async def read_resource(
        _: ServerRequestContext[Any], asked: types.ReadResourceRequestParams
    ) -> types.ReadResourceResult:
        if str(asked.uri) != SKILL:
            raise ToolError(f"{asked.uri}: no such resource; there is {SKILL}")
        text = types.TextResourceContents(uri=SKILL, mime_type="text/markdown", text=skill())
        return types.ReadResourceResult(contents=[text])

    return Server(
        NAME,
        version=version(NAME),
        title="Robot calibration inspector",
        instructions=skill().partition("---\n\n")[2],
        on_list_tools=list_tools,
        on_call_tool=call_tool,
        on_list_resources=list_resources,
        on_read_resource=read_resource,
    )


def run_mcp(options: McpOptions) -> int:
    """Serve the tools on stdin and stdout until the client ends it."""
    roots = Roots.of(options.root or [Path()])
    server = server_of(Toolbox(roots, options.timeout_s, options.allow_code))

    async def serve() -> None:
        async with stdio_server() as (received, sent):
            await server.run(received, sent, server.create_initialization_options())

    anyio.run(serve)
    return 0


def _figure_tool() -> types.Tool:
    properties = {
        "path": {"type": "string", "description": "dataset folder"},
        "name": {"type": "string", "description": "of the figure; without it, the names and captions of all"},
    }
    return types.Tool(
        name=FIGURE,
        description="a figure of the diagnosis as a picture, with its caption",
        input_schema={"type": "object", "properties": properties, "required": ["path"], "additionalProperties": False},
        annotations=types.ToolAnnotations(read_only_hint=True, open_world_hint=False),
    )


def _wanted_keys(tool: CommandTool, given: Mapping[str, Any]) -> list[str] | None:
    """Keys of the JSON document that a call asks for; None where it wants the text."""
    wanted = given.get(JSON_KEYS)
    if wanted is None:
        return None
    if not tool.gives_json:
        raise ToolError(f"{tool.name}: answers with text alone; leave {JSON_KEYS} out")
    if not isinstance(wanted, list) or not all(isinstance(key, str) for key in wanted):
        raise ToolError(f"{tool.name}: {JSON_KEYS} is a list of keys, found {wanted!r}")
    return wanted


def _said(ended: subprocess.CompletedProcess[bytes]) -> tuple[str, str]:
    out, err = (stream.decode("utf-8", "replace").strip() for stream in (ended.stdout, ended.stderr))
    # Progress that overwrites itself is for a terminal.
    return out, "\n".join(line for line in err.splitlines() if line.startswith(_SAID))


def _text_answer(ended: subprocess.CompletedProcess[bytes]) -> Answer:
    out, err = _said(ended)
    if ended.returncode == BAD or ended.returncode < 0:
        return Answer.of_text(err.removeprefix(_SAID) or out or f"ended by signal {-ended.returncode}", is_error=True)
    verdict = "" if ended.returncode == 0 else 'exit code 1: the answer is "not good enough"\n\n'
    return Answer.of_text("\n\n".join(part for part in (verdict + out, err) if part))


def _json_answer(ended: subprocess.CompletedProcess[bytes], wanted: list[str]) -> Answer:
    if ended.returncode not in (0, 1):
        return _text_answer(ended)
    document = json.loads(ended.stdout)
    if not wanted:
        return Answer.of_text("keys: " + ", ".join(document))
    missing = [key for key in wanted if key not in document]
    if missing:
        raise ToolError(f"no key {missing[0]!r} in the document; there are {', '.join(document)}")
    return Answer.of_text(json.dumps({key: document[key] for key in wanted}, ensure_ascii=False))
