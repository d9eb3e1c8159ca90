"""Tools of targets in drawn programs, beside those with which an interpreter of the test's own comes to each motion."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.errors import CalibError
from calib.extras.robot_programs.program_targets import load_program
from tests.extras.robot_programs.controllers import LANGUAGES

Statement = tuple  # ("set", k), ("move",), ("call", k), ("if", yes, no), ("loop", body)
ROUTINES = 3


def bodies(depth: int) -> st.SearchStrategy[list[Statement]]:
    simple = st.one_of(
        st.tuples(st.just("set"), st.integers(1, 3)),
        st.just(("move",)),
        st.tuples(st.just("call"), st.integers(1, ROUTINES - 1)),
    )
    if not depth:
        return st.lists(simple, max_size=4)
    inner = bodies(depth - 1)
    nested = st.one_of(
        st.tuples(st.just("if"), inner, inner), st.tuples(st.just("if"), inner), st.tuples(st.just("loop"), inner)
    )
    return st.lists(st.one_of(simple, nested), max_size=4)


TEXTS = {  # a routine, a motion, a tool, branch, rest, loop, and the ends of these
    "KRL": ("DEF r{}()", "LIN {{X 1,Y 2,Z 3,A 0,B 90,C 0}}", "$TOOL={{X {},Y 0,Z 0,A 0,B 0,C 0}}",
            "IF $IN[1] THEN", "ELSE", "WHILE $IN[1]", "END", "ENDIF", "ENDWHILE"),
    "URScript": ("def r{}():", "movel(p[0.1,0.2,0.3,0,3.1,0])", "set_tcp(p[0.00{},0,0,0,0,0])",
                 "if x():", "else:", "while x():", "end", "end", "end"),
}  # fmt: skip


class Writer:
    """Text of a program, with the lines of its motions."""

    def __init__(self, language: str) -> None:
        self.lines: list[str] = []
        self.routine, self.move, self.tool, self.branch, self.rest, self.loop, *self.ends = TEXTS[language]

    def body(self, statements: list[Statement]) -> list[Statement]:
        """The statements, each motion with its line."""
        return [self._statement(each) for each in statements]

    def _statement(self, each: Statement) -> Statement:
        kind = each[0]
        if kind == "move":
            self.lines.append(self.move.format())
            return ("move", len(self.lines))
        if kind in ("set", "call"):
            self.lines.append((self.tool if kind == "set" else "r{}()").format(each[1]))
            return each
        self.lines.append(self.loop if kind == "loop" else self.branch)
        parts = [self.body(each[1])]
        for rest in each[2:]:
            self.lines.append(self.rest)
            parts.append(self.body(rest))
        self.lines.append(self.ends[1 + (kind == "loop")])
        return (kind, *parts)


def run(
    statements: list[Statement],
    routines: list[list[Statement]],
    tool: int,
    draw: list[bool],
    seen: dict[int, set[int]],
    depth: int,
) -> int:
    """The tool after statements; `seen` gets the tools of each motion by its line."""
    for each in statements:
        if each[0] == "set":
            tool = each[1]
        elif each[0] == "move":
            seen.setdefault(each[1], set()).add(tool)
        elif each[0] == "call":
            if not depth:
                raise RecursionError  # the program does not end
            tool = run(routines[each[1]], routines, tool, draw, seen, depth - 1)
        elif each[0] == "if":
            chosen = draw.pop() if draw else False
            branch = each[1] if chosen else each[2] if len(each) > 2 else []
            tool = run(branch, routines, tool, draw, seen, depth)
        elif each[0] == "loop":
            while draw and draw.pop():
                tool = run(each[1], routines, tool, draw, seen, depth)
    return tool


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(sorted(TEXTS)),
    st.lists(bodies(2), min_size=ROUTINES, max_size=ROUTINES),
    st.lists(st.lists(st.booleans(), max_size=12), min_size=4, max_size=4),
)
def test_a_tool_that_is_told_is_the_one_on_every_way(
    tmp_path: Path, language: str, drawn: list[list[Statement]], ways: list[list[bool]]
) -> None:
    writer = Writer(language)
    routines: list[list[Statement]] = []
    for k, statements in enumerate(drawn):
        writer.lines.append(writer.routine.format(k))
        routines.append(writer.body(statements))
        writer.lines.append(writer.ends[0])
    path = tmp_path / f"a{LANGUAGES[language]}"
    path.write_text("\n".join(writer.lines) + "\n")
    try:
        found = load_program(path)
    except CalibError:
        return  # no target with one tool
    told = {
        target.line: 0 if target.tool.transform is None else round(target.tool.transform[0, 3])
        for target in found.targets
        if target.tool is not None
    }
    seen: dict[int, set[int]] = {}
    for way in ways:
        with suppress(RecursionError):
            run(routines[0], routines, 0, list(way), seen, 30)
    for line, tool in told.items():
        assert seen.get(line, {tool}) == {tool}
