"""A fleet, as `fleet --json` prints it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from calib.fleet.result import Fleet


def fleet_document(fleet: Fleet) -> dict[str, Any]:
    """All rows, what they share, what changed, and what failed."""
    return {
        "folder": str(fleet.folder),
        "datasets": len(fleet.rows) + len(fleet.failures),
        "taken_over": fleet.taken_over,
        "seconds": fleet.seconds,
        "rows": _documents(fleet.rows),
        "failed": _documents(fleet.failures),
        "drift": [{**asdict(drift), "of_the_arm": bool(drift.of_the_arm)} for drift in fleet.drifts],
        "shared_causes": [
            {**asdict(cause), "groups": [asdict(group) for group in cause.groups]} for cause in fleet.shared
        ],
        "worst": [row.path for row in fleet.worst()],
    }


def _documents(values: Sequence[Any]) -> list[dict[str, Any]]:
    return [asdict(value) for value in values]
