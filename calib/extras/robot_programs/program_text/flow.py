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
    events = sorted(marks, key=lambda each: each.place)
    for mark in events:
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
    walk = _Walk(routines, frozenset([before, *(mark.value for mark in events if mark.value is not None)]))
    start, called = frozenset([before]), {mark.name for mark in events if mark.kind == "call"}
    after = walk.through(whole.branches[0], start)
    for block in routines.values():
        if block.name not in called:
            walk.through(block.branches[0], after if top_first else start)
    for block in (*routines.values(), *doubles):  # those that only call each other
        if block.name not in walk.entered or block in doubles:
            walk.through(block.branches[0], start)
    for block in routines.values() if walk.is_recursive else ():
        walk.through(block.branches[0], walk.everything)
    return {mark.place: frozenset(walk.found.get(mark.place, start)) for mark in events if mark.kind == "use"}


class _Walk(Generic[Value]):
    def __init__(self, routines: dict[str, _Block[Value]], everything: frozenset[Value]) -> None:
        self._routines = routines
        self._after: dict[tuple[str, frozenset[Value]], frozenset[Value]] = {}  # a routine that begins with values
        self._running: list[str] = []
        self.everything = everything
        self.found: dict[int, set[Value]] = {}
        self.entered: set[str] = set()
        self.is_recursive = False  # routines call themselves, or are called too deep to be followed

    def through(self, parts: Sequence[FlowEvent[Value] | _Block[Value]], state: frozenset[Value]) -> frozenset[Value]:
        for part in parts:
            if isinstance(part, _Block):
                state = self._block(part, state)
            elif part.kind == "set" and part.value is not None:
                state = frozenset([part.value])
            elif part.kind == "use":
                self.found.setdefault(part.place, set()).update(state)
            elif part.kind == "call" and part.name in self._routines:
                state = self._call(part.name, state)
        return state

    def _block(self, block: _Block[Value], state: frozenset[Value]) -> frozenset[Value]:
        if block.kind in ("loop", "always"):
            state = state | self.through(block.branches[0], state)
            after = self.through(block.branches[0], state)
            return after if block.kind == "always" else state | after
        ends = [self.through(branch, state) for branch in block.branches]
        return frozenset().union(*ends, frozenset() if block.complete else state)

    def _call(self, name: str, state: frozenset[Value]) -> frozenset[Value]:
        self.entered.add(name)
        if name in self._running or len(self._running) > _DEEPEST:  # then anything may hold before and behind it
            self.is_recursive = True
            return self.everything
        if (name, state) not in self._after:
            self._running.append(name)
            self._after[name, state] = self.through(self._routines[name].branches[0], state)
            self._running.pop()
        return self._after[name, state]
