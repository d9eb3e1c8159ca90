"""Expressions of a xacro have Python's values where a robot's description needs them, and are refused otherwise."""

from __future__ import annotations

import math
from typing import Any

import pytest

from calib.robot_formats.urdf.expressions import (
    BASICS,
    MATHS,
    Budget,
    ExpressionError,
    Namespace,
    evaluate,
)

NAMES: dict[str, Any] = {
    **MATHS,
    **BASICS,
    "math": Namespace(MATHS),
    "python": Namespace(BASICS),
    "size": {"d1": 0.36, "arms": [{"name": "left"}, {"name": "right"}], "get": 3},
    "prefix": "ur_",
    "n": 4,
    "huge": "x" * 900_000,
}
PLAIN = {name: value for name, value in NAMES.items() if not isinstance(value, Namespace)}


def value(text: str) -> Any:
    return evaluate(text, NAMES, Budget())


@pytest.mark.parametrize(
    "text",
    [
        "1 + 2 * -3 / 4 - 2**3 % 5 + 7 // 2",
        "0.1 + 0.2",
        "sin(pi / 3) + math.cos(radians(30.0))",
        "'a' + prefix * 2 if n > 3 else 'b'",
        "not n == 4 or n in [1, 2, 4] and n != 5",
        "1 < n <= 4 < 5",
        "size['arms'][1]['name'].upper()",
        "'1 2 3'.split()[2]",
        "prefix.startswith('ur') and not prefix.endswith('x')",
        "'%s%02d %.3f' % (prefix, 7, pi)",
        "max(1, min(n, 3)), abs(-2), round(pi, 2), len(prefix)",
        "[x * 2 for x in range(5) if x != 3]",
        "any([n == k for k in [3, 4]])",
        "list(map(float, '1 2'.split(' ')))",
        "dict(a=1, b=2)['b'] + {'c': 3}['c']",
        "int('12') + float('1e-3') + bool(0)",
        "sum([1, 2.5]), sorted([3, 1, 2], reverse=True)",
        "'abcdef'[1:4] + str(1.5)",
        "prefix if prefix else None",
        "'-'.join(['a', 'b']).replace('-', '+')",
    ],
)
def test_it_is_what_python_says(text: str) -> None:
    functions = {name: getattr(made, "call", made) for name, made in PLAIN.items() if name not in ("all", "any", "map")}
    space = type("Space", (), {name: staticmethod(made.call) for name, made in MATHS.items() if hasattr(made, "call")})
    theirs = eval(text, {**functions, "math": space, "str": str, "map": map, "any": any})
    mine = value(text)
    assert mine == (list(theirs) if isinstance(theirs, tuple) else theirs)


def test_keys_of_a_table_stand_behind_a_dot_too() -> None:
    assert value("size.d1") == 0.36
    assert value("size.get") == 3  # a key wins: there is no Python behind it
    assert value("size.arms[0].name") == "left"
    assert value("python.len(prefix)") == 3
    assert math.isnan(value("nan"))


@pytest.mark.parametrize(
    "text",
    [
        "().__class__",
        "(lambda: 1)()",
        "prefix.__class__",
        "prefix.format",
        "'{0.__class__}'.format(1)",
        "sin.__self__",
        "sin.call",
        "math.names",
        "math.__dict__",
        "size.__class__",
        "size.items.__self__",
        "[].append",
        "[c for c in ().__class__.__mro__]",
        "(x for x in [1]).gi_frame",
        "(y := 1)",
        "f'{prefix}'",
        "f'{prefix!r:>1000000000}'",
        "__import__('os')",
        "__builtins__",
        "open('/etc/passwd')",
        "eval('1')",
        "getattr(prefix, 'upper')",
        "type(1)",
        "vars()",
        "python.type(1)",
        "sorted([1], key=str)",
        "max(*[1, 2])",
        "dict(**{'a': 1})",
        "[sin][0](1)",
        "(sin if n else cos)(1)",
        "sin",
        "math",
        "str(sin)",
        "'%r' % (1,)",
        "'%*d' % (10, 1)",
        "'%1000000000d' % 1",
        "'%.1000000000f' % 1.0",
        "'%(a)s' % size",
        "b'a'",
        "1j",
        "...",
        "{1, 2}",
        "~n",
        "n << 100000",
        "(-8) ** 0.5",
        "await x",
        "(yield)",
    ],
)
def test_there_is_nothing_of_python_to_reach(text: str) -> None:
    with pytest.raises(ExpressionError):
        value(text)


@pytest.mark.parametrize(
    "text",
    [
        "10**10**10",
        "(10**100)**(10**3)",
        "2**1023 * 2**1023",
        "'a' * 10**12",
        "10**9 * [1]",
        "huge + huge",
        "huge.replace('x', 'xxxxxxxxxx')",
        "huge.join(['a', 'b', 'c'])",
        "[huge] * 99999",
        "range(10**12)",
        "range(10**30)",
        "[1 for i in range(99999) for j in range(99999)]",
        pytest.param("sum([1 for i in range(99999) if sum([0 for j in range(99999)])])", marks=pytest.mark.slow),
        "factorial(10**9)",
        "comb(10**9, 10**8)",
        "(" * 9000 + "1" + ")" * 9000,
        "-" * 15_000 + "1",
        "1+" * 8000 + "1",
        "n" + ".n" * 9000,
        "[" * 199 + "]" * 199,
        "1" * 30_000,
        "int('9' * 4000)",
    ],
)
def test_nothing_grows_without_end(text: str) -> None:
    with pytest.raises(ExpressionError):
        value(text)


def test_one_budget_is_for_all_expressions_of_a_file() -> None:
    budget = Budget(10)
    evaluate("1 + 1", NAMES, budget)
    evaluate("n", NAMES, budget)
    with pytest.raises(ExpressionError, match="too many steps"):
        evaluate("1 + 1", NAMES, budget)
