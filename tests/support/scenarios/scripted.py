"""A scripted agent: it follows the guide that the server hands out, with the tools alone, and keeps what it is told."""

from __future__ import annotations

import json
from typing import Any

from mcp import Client, types

from tests.support.scenarios.scenarios import Found


def text_of(answer: types.CallToolResult) -> str:
    """All text of an answer."""
    return "\n".join(one.text for one in answer.content if isinstance(one, types.TextContent))


async def work(client: Client, folder: str, options: dict[str, Any] | None = None) -> Found:
    """Import what is in a folder, diagnose it, and calibrate; an answer that refuses ends the work, and is told."""
    told: list[str] = []
    cell = f"{folder}_cell"
    made = await client.call_tool("import", {"path": cell} | (options or {"from": folder}))
    told.append(text_of(made))
    if made.is_error:
        return Found("\n".join(told), {}, {})
    diagnosis = await client.call_tool("diagnose", {"path": cell})
    told.append(text_of(diagnosis))
    if diagnosis.is_error:
        return Found("\n".join(told), {}, {})
    keys = [
        "verdict",
        "missing",
        "suspected",
        "ambiguous_set",
        "open_sets",
        "data_problem",
        "tool_found_mm",
        "left_out",
    ]
    parts = await client.call_tool("diagnose", {"path": cell, "json_keys": keys})
    checked = await client.call_tool("check", {"path": cell})
    told.append(text_of(checked))
    calibrated: dict[str, Any] = {}
    if "the camera is" in told[0]:
        asked = {"path": cell, "residual": "pose", "json_keys": ["hand_eye", "arm_or_camera"]}
        calibrated = json.loads(text_of(await client.call_tool("calibrate", asked)))
    return Found("\n".join(told), json.loads(text_of(parts)), calibrated)
