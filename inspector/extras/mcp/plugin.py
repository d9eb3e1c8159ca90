"""What the tools for agents bring."""

from inspector.plugins import Command, PipExtra

CONTRIBUTIONS = (
    Command("mcp", "inspector.extras.mcp.options:McpOptions", "inspector.extras.mcp.server:run_mcp"),
    PipExtra("agent", ("mcp", "anyio", "pydantic")),
)
