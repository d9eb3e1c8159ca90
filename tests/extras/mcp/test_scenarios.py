"""What an agent comes to that has nothing but an owner's folder and the tools, over faults whose cause is known."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Sequence
from pathlib import Path

import pytest
from mcp import Client

from inspector.extras.mcp.roots import Roots
from inspector.extras.mcp.server import Toolbox, server_of
from tests.support.scenarios.scenarios import SCENARIOS, Scenario
from tests.support.scenarios.scripted import work
from tests.support.sweeps import sweep


def not_right(root: Path, scenarios: Sequence[Scenario]) -> tuple[Collection[str], Collection[str]]:
    """Names of scenarios without the right cause or next measurement, and of those where something false is claimed."""

    async def ask() -> tuple[set[str], set[str]]:
        missed, wrong = set(), set()
        async with Client(server_of(Toolbox(Roots.of([root]), timeout_s=300.0))) as client:
            for scenario in scenarios:
                scenario.write(root / scenario.name)
                found = await work(client, scenario.name, dict(scenario.options))
                missed |= set() if scenario.is_right(found) else {scenario.name}
                wrong |= {scenario.name} if found.claimed - set(scenario.may_claim) else set()
        return missed, wrong

    return asyncio.run(ask())


@pytest.mark.slow
@pytest.mark.parametrize("name", sweep(["joint_zero", "blunders"], every_run=["joint_zero"]))
def test_the_cause_is_found_from_the_folder_alone(name: str, tmp_path: Path) -> None:
    assert not_right(tmp_path, [one for one in SCENARIOS if one.name == name]) == (set(), set())


@pytest.mark.timeout(1800)
@pytest.mark.thorough
def test_an_agent_comes_to_the_right_cause_or_measurement_and_claims_nothing_false(tmp_path: Path) -> None:
    missed, wrong = not_right(tmp_path, SCENARIOS)
    assert wrong == set()
    assert len(missed) <= len(SCENARIOS) // 11, missed  # 21 of 23
