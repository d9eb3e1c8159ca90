"""Which assignments reach a place of a program: branches, loops, and routines called from elsewhere are followed.

Nothing is computed: every branch may be taken. What several assignments may reach has several values, and what none
reaches the value from before the program. Each routine is walked with a mark in place of what holds at its entry;
behind a call hold what the routine sets and, where the mark comes through, what held before.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

FlowKind = Literal[
    "routine", "if", "switch", "loop", "always", "else", "otherwise", "end", "call", "set", "use"
]  # fmt: skip
"""A `switch` is an `if` whose first branch an `else` begins, which is one more branch; `otherwise` is the branch of
whatever is left, `always` a loop that is entered in any case."""

Values = frozenset[Any]
"""What may hold at a place."""


@dataclass(frozen=True)
class FlowEvent:
    """Something at a place of a program that its flow depends on."""

    place: int
    kind: FlowKind
    name: str = ""  # of a routine or a call
    value: Hashable | None = None  # of a "set"


@dataclass(frozen=True)
class _AtEntry:
    """Whatever holds where a routine begins; "" is what stands outside of routines."""

    name: str


@dataclass(eq=False)
class _Block:
    """A block of the program: its parts in their order, for each branch."""

    kind: FlowKind
    branches: list[list[FlowEvent | _Block]] = field(default_factory=list)
    complete: bool = False  # one of the branches is always taken


def reaching(marks: Iterable[FlowEvent], before: Hashable, *, top_first: bool) -> dict[int, Values]:
    """Values that may hold at each "use", by its place.

    Args:
        marks: of the program; of those at one place the "use" comes before the "set".
        before: the value at the start.
        top_first: whether what stands outside of routines runs before those that nothing calls.
    """
    events = sorted(marks, key=lambda each: each.place)
    walk = _Walk(_routines(events))
    top = walk.behind[""] if top_first else frozenset([_AtEntry("")])
    begins = {name: walk.calls.get(name, top) for name in walk.routines} | {"": frozenset([before])}
    everything = frozenset([before, *(mark.value for mark in events if mark.value is not None)])

    def resolved(values: Values, passed: frozenset[str] = frozenset()) -> Values:
        plain = frozenset(value for value in values if not isinstance(value, _AtEntry))
        names = {value.name for value in values - plain} - passed
        return plain.union(*(resolved(begins[name], passed | names) for name in names))

    uses = (mark.place for mark in events if mark.kind == "use")
    return {place: resolved(walk.found.get(place, frozenset())) or everything for place in uses}


def _routines(events: Iterable[FlowEvent]) -> dict[str, _Block]:
    """Blocks of the routines by their names, "" of what stands outside; several of one name are branches."""
    routines = {"": _Block("routine", [[]], complete=True)}
    open_ = [routines[""]]
    for mark in events:
        inner = open_[-1]
        parts = inner.branches[-1] if inner.branches else []  # of a switch, nothing runs before its first case
        if mark.kind == "routine":
            block = routines.setdefault(mark.name, _Block("routine", complete=True))
            block.branches.append([])
            open_.append(block)
        elif mark.kind in ("if", "switch", "loop", "always"):
            block = _Block(mark.kind, [] if mark.kind == "switch" else [[]])
            parts.append(block)
            open_.append(block)
        elif mark.kind in ("else", "otherwise"):
            if inner.kind in ("if", "switch"):
                inner.branches.append([])
                inner.complete |= mark.kind == "otherwise"
        elif mark.kind == "end":
            open_ = open_[:-1] or open_
        else:
            parts.append(mark)
    return routines


class _Walk:
    """What holds at each use and call, and behind each routine, walked until nothing more is found."""

    def __init__(self, routines: dict[str, _Block]) -> None:
        self.routines = routines
        self.behind: dict[str, Values] = dict.fromkeys(routines, frozenset())
        self.found: dict[int, Values] = {}
        self.calls: dict[str, Values] = {}
        last = None
        while last != self.behind:
            last = dict(self.behind)
            for name, block in routines.items():
                self.behind[name] = self._block(block, frozenset([_AtEntry(name)]))

    def _through(self, parts: Sequence[FlowEvent | _Block], state: Values) -> Values:
        for part in parts:
            if isinstance(part, _Block):
                state = self._block(part, state)
            elif part.kind == "set":
                state = frozenset([part.value])
            elif part.kind == "use":
                self.found[part.place] = self.found.get(part.place, frozenset()) | state
            elif part.name in self.routines:
                self.calls[part.name] = self.calls.get(part.name, frozenset()) | state
                own = frozenset([_AtEntry(part.name)])
                behind = self.behind[part.name]
                state = behind - own | (state if own <= behind else frozenset())
        return state

    def _block(self, block: _Block, state: Values) -> Values:
        if block.kind in ("loop", "always"):
            state = state | self._through(block.branches[0], state)
            after = self._through(block.branches[0], state)
            return after if block.kind == "always" else state | after
        ends = [self._through(branch, state) for branch in block.branches]
        return frozenset().union(*ends, frozenset() if block.complete else state)
