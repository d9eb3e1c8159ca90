"""Which assignments reach a place of a program: branches, loops, and routines called from elsewhere are followed.

Nothing is computed: every branch may be taken. What several assignments may reach has several values, and what none
reaches the value from before the program.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Generic, Literal, TypeVar

FlowKind = Literal[
    "routine", "if", "switch", "loop", "always", "else", "otherwise", "end", "call", "set", "use"
]  # fmt: skip
"""A `switch` is an `if` whose first branch an `else` begins, which is one more branch; `otherwise` is the branch of
whatever is left, `always` a loop that is entered in any case."""
_OPENING = ("routine", "if", "switch", "loop", "always")
_DEEPEST = 40  # calls within calls that are followed

Value = TypeVar("Value", bound=Hashable)
Held = TypeVar("Held", bound=Hashable, covariant=True)


@dataclass(frozen=True)
class FlowEvent(Generic[Held]):
    """Something at a place of a program that its flow depends on."""

    place: int
    kind: FlowKind
    name: str = ""  # of a routine or a call
    value: Held | None = None  # of a "set"


@dataclass(eq=False)
class _Block(Generic[Value]):
    """A block of the program, or the whole: its parts in their order, for each branch."""

    kind: FlowKind
    name: str = ""
    branches: list[list[FlowEvent[Value] | _Block[Value]]] = field(default_factory=lambda: [[]])
    complete: bool = False  # one of the branches is always taken

    def add(self, part: FlowEvent[Value] | _Block[Value]) -> None:
        if not self.branches:
            self.branches.append([])
        self.branches[-1].append(part)


def reaching(marks: Iterable[FlowEvent[Value]], before: Value, *, top_first: bool) -> dict[int, frozenset[Value]]:
    """Values that may hold at each "use", by its place.

    Args:
        marks: of the program; of those at one place the "use" comes before the "set".
        before: the value at the start.
        top_first: whether what stands outside of routines runs before those that nothing calls.
    """
    whole: _Block[Value] = _Block("routine")
    routines: dict[str, _Block[Value]] = {}
    open_ = [whole]
    doubles: list[_Block[Value]] = []  # routines of a name that another one has
    uses: list[int] = []
    for mark in sorted(marks, key=lambda each: each.place):
        inner = open_[-1]
        if mark.kind in _OPENING:
            block: _Block[Value] = _Block(mark.kind, mark.name, [] if mark.kind == "switch" else [[]])
            if mark.kind != "routine":
                inner.add(block)
            elif routines.setdefault(mark.name, block) is not block:
                doubles.append(block)
            open_.append(block)
        elif mark.kind in ("else", "otherwise"):
            if inner.kind in ("if", "switch"):
                inner.branches.append([])
                inner.complete |= mark.kind == "otherwise"
        elif mark.kind == "end":
            open_ = open_[:-1] or open_
        else:
            inner.add(mark)
            uses += [mark.place] if mark.kind == "use" else []
    walk = _Walk(routines, whole)
    start = frozenset([before])
    while walk.changed:
        walk.start()
        after = walk.through(whole.branches[0], start, 0)
        for block in routines.values():
            if block.name not in walk.called:
                walk.through(block.branches[0], (after or start) if top_first else start, 0)
        for block in (*routines.values(), *doubles):  # those that only call each other
            if block.name not in walk.entered or block in doubles:
                walk.through(block.branches[0], start, 0)
    return {place: frozenset(walk.found.get(place, start)) or start for place in uses}


class _Walk(Generic[Value]):
    def __init__(self, routines: dict[str, _Block[Value]], whole: _Block[Value]) -> None:
        self._routines = routines
        self._after: dict[tuple[str, frozenset[Value]], frozenset[Value]] = {}
        self._done: set[tuple[str, frozenset[Value]]] = set()
        self._running: set[tuple[str, frozenset[Value]]] = set()
        self.changed = True
        self.found: dict[int, set[Value]] = {}
        self.called = {
            mark.name for block in (whole, *routines.values()) for mark in _calls(block) if mark.name != block.name
        }
        self.entered: set[str] = set()

    def start(self) -> None:
        """Begin another pass, which ends unchanged once what routines return is found."""
        self._done.clear()
        self.changed = False

    def through(
        self, parts: Sequence[FlowEvent[Value] | _Block[Value]], state: frozenset[Value], depth: int
    ) -> frozenset[Value]:
        for part in parts:
            if isinstance(part, _Block):
                state = self._block(part, state, depth)
            elif part.kind == "set" and part.value is not None:
                state = frozenset([part.value])
            elif part.kind == "use":
                self.found.setdefault(part.place, set()).update(state)
            elif part.kind == "call":
                state = self._call(part.name, state, depth)
        return state

    def _block(self, block: _Block[Value], state: frozenset[Value], depth: int) -> frozenset[Value]:
        if block.kind in ("loop", "always"):
            state = state | self.through(block.branches[0], state, depth)
            after = self.through(block.branches[0], state, depth)
            return after if block.kind == "always" else state | after
        ends = [self.through(branch, state, depth) for branch in block.branches]
        return frozenset().union(*ends, frozenset() if block.complete else state)

    def _call(self, name: str, state: frozenset[Value], depth: int) -> frozenset[Value]:
        block = self._routines.get(name)
        if block is None or depth > _DEEPEST:
            return state
        self.entered.add(name)
        key = (name, state)
        if key in self._running:  # it calls itself: what the pass before found counts
            return self._after.get(key, frozenset()) | state
        if key not in self._done:
            self._done.add(key)
            self._running.add(key)
            after = self.through(block.branches[0], state, depth + 1) | self._after.get(key, frozenset())
            self.changed |= after != self._after.get(key)
            self._after[key] = after
            self._running.remove(key)
        return self._after[key]


def _calls(block: _Block[Value]) -> list[FlowEvent[Value]]:
    found: list[FlowEvent[Value]] = []
    for part in [part for branch in block.branches for part in branch]:
        if isinstance(part, _Block):
            found += _calls(part)
        elif part.kind == "call":
            found.append(part)
    return found
