"""Expressions of a xacro, evaluated by walking their syntax tree: arithmetic on plain data, and no Python object.

`ast.parse` makes the tree and runs nothing. What is not listed here does not exist: an attribute is a key of a table
or a name of a namespace, never Python's; a call is one of a fixed set of functions on numbers, texts, lists and
tables. So there is nothing to get out of. Sizes, depth and the number of steps are bounded.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

MOST_CHARACTERS = 20_000  # of an expression
MOST_DEPTH = 100  # of its tree
MOST_STEPS = 3_000_000  # of all expressions of a file together
MOST_TEXT = 1_000_000  # characters of a result
MOST_ITEMS = 100_000  # of a list or table, those within it counted
MOST_BITS = 1024  # of an integer: beyond any float


class ExpressionError(Exception):
    """What an expression may not do, or cannot."""


class NameTable(Protocol):
    """Where the values of names are looked up; KeyError where there is none."""

    def __getitem__(self, name: str, /) -> Any: ...


@dataclass(frozen=True)
class Function:
    """A function that an expression may call, and do nothing else with."""

    name: str
    call: Callable[..., Any]


@dataclass(frozen=True)
class Namespace:
    """Names behind a dot: `math.sin`."""

    names: NameTable


@dataclass
class Budget:
    """How much is left for all expressions of a file."""

    steps: int = field(default=MOST_STEPS)

    def spend(self, steps: int) -> None:
        self.steps -= steps
        if self.steps < 0:
            raise ExpressionError("the expressions of this file take too many steps")


def evaluate(text: str, names: NameTable, budget: Budget) -> Any:
    """The value of an expression: None, bool, int, float, str, or lists and tables of them. Raises ExpressionError."""
    if len(text) > MOST_CHARACTERS:
        raise ExpressionError(f"an expression has {len(text)} characters; at most {MOST_CHARACTERS} are read")
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError) as error:
        raise ExpressionError(f"is no expression ({' '.join(str(error).split())})") from None
    except (RecursionError, MemoryError):
        raise ExpressionError("is nested too deep") from None
    value = _Evaluation(names, budget).value(tree.body, 0)
    if isinstance(value, Function | Namespace):
        raise ExpressionError("names a function or a namespace, which has no value by itself")
    return value


def plain(value: Any, budget: Budget) -> Any:
    """The same as plain data of bounded size. Raises ExpressionError for anything else."""
    return _plain(value, budget, [0], 0)


def _plain(value: Any, budget: Budget, count: list[int], depth: int) -> Any:
    count[0] += 1
    if count[0] > MOST_ITEMS or depth > MOST_DEPTH:
        raise ExpressionError("a list or table is too large")
    budget.spend(1)
    if value is None or isinstance(value, bool | float):
        return value
    if isinstance(value, int):
        if value.bit_length() > MOST_BITS:
            raise ExpressionError("an integer is too large")
        return int(value)
    if isinstance(value, str):
        count[0] += len(value) // 100
        if len(value) > MOST_TEXT:
            raise ExpressionError(f"a text has more than {MOST_TEXT} characters")
        return str(value)
    if isinstance(value, dict):
        return {
            _plain(key, budget, count, depth + 1): _plain(inside, budget, count, depth + 1)
            for key, inside in value.items()
            if _is_key(key)
        }
    if isinstance(value, list | tuple):
        return [_plain(inside, budget, count, depth + 1) for inside in value]
    raise ExpressionError(f"a value is no number, text, list or table ({type(value).__name__})")


def _is_key(key: object) -> bool:
    if key is None or isinstance(key, str | int | float):
        return True
    raise ExpressionError("a table's key is no text and no number")


# ---- operators ------------------------------------------------------------------------------------------------------


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def _power(base: Any, exponent: Any) -> Any:
    _require(_is_number(base) and _is_number(exponent), "** takes numbers")
    if isinstance(base, int) and isinstance(exponent, int) and exponent > 0:
        _require(base.bit_length() * exponent <= MOST_BITS, "an integer is too large")
    value = base**exponent
    _require(not isinstance(value, complex), "** has no real value here")
    return value


def _product(left: Any, right: Any) -> Any:
    if not (_is_number(left) and _is_number(right)):
        repeated, count = (right, left) if isinstance(left, int) else (left, right)
        _require(
            isinstance(repeated, str | list) and type(count) is int,
            "* takes numbers, or a text or list and an integer",
        )
        most = MOST_TEXT if isinstance(repeated, str) else MOST_ITEMS
        _require(len(repeated) * max(count, 0) <= most, "a repeated text or list is too large")
    return left * right


def _remainder(left: Any, right: Any) -> Any:
    if isinstance(left, str):
        places = re.findall(r"%[^%a-zA-Z]*[%a-zA-Z]?", left)
        _require(
            all(re.fullmatch(r"%%|%[-+ 0]?\d{0,2}(\.\d{1,2})?[sdfgeixX]", place) for place in places),
            "a format has other than %s %d %f %g %e %x, of at most two digits",
        )
        given = tuple(right) if isinstance(right, list) else right
        _require(not isinstance(given, dict), "a format takes no table")
        return left % given
    _require(_is_number(left) and _is_number(right), "% takes numbers")
    return left % right


def _numeric(function: Callable[[Any, Any], Any], sign: str) -> Callable[[Any, Any], Any]:
    def on(left: Any, right: Any) -> Any:
        _require(_is_number(left) and _is_number(right), f"{sign} takes numbers")
        return function(left, right)

    return on


def _sum(left: Any, right: Any) -> Any:
    both_texts = isinstance(left, str) and isinstance(right, str)
    both_lists = isinstance(left, list) and isinstance(right, list)
    _require(
        both_texts or both_lists or (_is_number(left) and _is_number(right)),
        f"+ takes two numbers, two texts or two lists, not {_kind(left)} and {_kind(right)}",
    )
    return left + right


_BINARY: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: _sum,
    ast.Sub: _numeric(operator.sub, "-"),
    ast.Mult: _product,
    ast.Div: _numeric(operator.truediv, "/"),
    ast.FloorDiv: _numeric(operator.floordiv, "//"),
    ast.Mod: _remainder,
    ast.Pow: _power,
}
_UNARY: Mapping[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda left, right: left in right,
    ast.NotIn: lambda left, right: left not in right,
    ast.Is: lambda left, right: left is right,
    ast.IsNot: lambda left, right: left is not right,
}


def _kind(value: object) -> str:
    kinds = {str: "a text", list: "a list", dict: "a table", type(None): "nothing"}
    return kinds.get(type(value), "a number" if _is_number(value) else "no value")


def _require(kept: bool, said: str) -> None:
    if not kept:
        raise ExpressionError(said)


# ---- functions ------------------------------------------------------------------------------------------------------


def _integer(value: Any = 0, base: Any = 10) -> int:
    _require(not isinstance(value, str) or len(value) <= 400, "int() of a text of that length")
    return int(value) if base == 10 else int(value, base)


def _text(value: Any = "") -> str:
    return str(value)


def _table(*given: Mapping[object, object] | Iterable[tuple[object, object]], **named: object) -> dict[object, object]:
    _require(len(given) <= 1, "dict() takes one list or table")
    made: dict[object, object] = dict(*given)
    made.update(named)
    return made


def _range(*ends: Any) -> list[int]:
    _require(all(type(end) is int for end in ends) and 1 <= len(ends) <= 3, "range() takes one to three integers")
    numbers = range(*ends)
    _require(_length_of(numbers) <= MOST_ITEMS, "range() of so many")
    return list(numbers)


def _length_of(numbers: range) -> int:
    """Its length where `len` would be too large for the machine."""
    span = numbers.stop - numbers.start
    return max(0, -(-span // numbers.step))


def _round(value: Any, digits: Any = None) -> Any:
    _require(digits is None or (isinstance(digits, int) and abs(digits) <= 300), "round() to so many digits")
    return round(value, digits)


def _mapped(function: Callable[..., Any], *lists: Any) -> list[Any]:
    return [function(*given) for given in zip(*lists, strict=False)]


def _small(function: Callable[..., Any], most: int) -> Callable[..., Any]:
    """The function of integers of bounded size: those whose results grow without end."""

    def bounded(*given: Any) -> Any:
        small = all(_is_number(value) and abs(value) <= most for value in given)
        _require(small, f"numbers of at most {most} are needed")
        return function(*given)

    return bounded


_MATHS: dict[str, Any] = {
    name: Function(name, getattr(math, name))
    for name in (
        "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "ceil", "copysign", "cos", "cosh", "degrees",
        "dist", "erf", "erfc", "exp", "expm1", "fabs", "floor", "fmod", "fsum", "gamma", "gcd", "hypot", "isclose",
        "isfinite", "isinf", "isnan", "ldexp", "lgamma", "log", "log10", "log1p", "log2", "pow",
        "radians", "remainder", "sin", "sinh", "sqrt", "tan", "tanh", "trunc",
    )
}  # fmt: skip
MATHS: Mapping[str, Any] = (
    _MATHS
    | {name: Function(name, _small(getattr(math, name), 150)) for name in ("factorial", "comb", "perm")}
    | {name: getattr(math, name) for name in ("pi", "e", "tau", "inf", "nan")}
)


def _added(given: Iterable[Any], start: Any) -> Any:
    total = start
    for value in given:
        total = _sum(total, value)
    return total


_BASICS: dict[str, Callable[..., Any]] = {
    "list": lambda given=(): list(given), "dict": _table, "map": _mapped, "len": len, "str": _text,
    "float": lambda value=0.0: float(value),
    "int": _integer, "bool": lambda value=False: bool(value), "min": min, "max": max, "round": _round,
    "sorted": sorted, "range": _range, "abs": abs, "all": all, "any": any,
    "sum": lambda given, start=0: _added(given, start),
    "tuple": lambda given=(): list(given), "zip": lambda *given: [list(row) for row in zip(*given, strict=False)],
    "enumerate": lambda given, start=0: [list(row) for row in enumerate(given, start)],
    "reversed": lambda given: list(reversed(given)), "divmod": lambda left, right: list(divmod(left, right)),
}  # fmt: skip
BASICS: Mapping[str, Any] = {
    **{name: Function(name, call) for name, call in _BASICS.items()},
    "True": True,
    "False": False,
}


def _replaced(text: str, old: Any, new: Any) -> str:
    _require(isinstance(old, str) and isinstance(new, str), "replace() takes texts")
    _require(len(text) + text.count(old) * len(new) <= MOST_TEXT, "a text is too large")
    return text.replace(old, new)


def _joined(between: str, texts: Any) -> str:
    parts = list(texts)
    _require(sum(len(part) + len(between) for part in parts) <= MOST_TEXT, "a text is too large")
    return between.join(parts)


_METHODS: Mapping[type, Mapping[str, Callable[..., Any]]] = {
    str: {
        "capitalize": str.capitalize, "count": str.count, "endswith": str.endswith, "find": str.find,
        "isdigit": str.isdigit, "join": _joined, "lower": str.lower, "lstrip": str.lstrip, "replace": _replaced,
        "rfind": str.rfind, "rsplit": str.rsplit, "rstrip": str.rstrip, "split": str.split,
        "startswith": str.startswith, "strip": str.strip, "title": str.title, "upper": str.upper,
    },
    dict: {
        "get": lambda table, key, default=None: table.get(key, default),
        "items": lambda table: [list(row) for row in table.items()],
        "keys": lambda table: list(table), "values": lambda table: list(table.values()),
    },
    list: {"count": list.count, "index": list.index},
}  # fmt: skip


# ---- the walk -------------------------------------------------------------------------------------------------------


class _Evaluation:
    """The walk over one expression's tree."""

    def __init__(self, names: NameTable, budget: Budget) -> None:
        self._names, self._budget = names, budget
        self._local: dict[str, Any] = {}  # of comprehensions

    def value(self, node: ast.AST, depth: int) -> Any:
        """The value of a node. Functions and namespaces come out where they are called or looked into alone."""
        self._budget.spend(1)
        if depth > MOST_DEPTH:
            raise ExpressionError("is nested too deep")
        walk = _WALKS.get(type(node))
        if walk is None:
            raise ExpressionError(f"has {_words(node)}, which a robot's description may not")
        try:
            return walk(self, node, depth + 1)
        except (ArithmeticError, TypeError, ValueError, LookupError, AttributeError) as error:
            raise ExpressionError(" ".join(str(error).split())[:200] or type(error).__name__) from None

    def data(self, node: ast.AST, depth: int) -> Any:
        """The value of a node (`value`), which has to be plain data."""
        value = self.value(node, depth)
        if isinstance(value, Function | Namespace):
            raise ExpressionError("takes a function or a namespace for a value")
        return value

    def _constant(self, node: ast.Constant, depth: int) -> Any:
        if not isinstance(node.value, str | int | float | None):
            raise ExpressionError("has a constant that is no number and no text")
        return plain(node.value, self._budget)

    def _name(self, node: ast.Name, depth: int) -> Any:
        if node.id in self._local:
            return self._local[node.id]
        try:
            return self._found(self._names[node.id])
        except KeyError:
            raise ExpressionError(f"name {node.id!r} is not defined") from None

    def _found(self, value: Any) -> Any:
        return value if isinstance(value, Function | Namespace) else plain(value, self._budget)

    def _attribute(self, node: ast.Attribute, depth: int) -> Any:
        owner = self.value(node.value, depth)
        if isinstance(owner, Namespace):
            try:
                return self._found(owner.names[node.attr])
            except KeyError:
                raise ExpressionError(f"name {node.attr!r} is not defined") from None
        if isinstance(owner, dict):
            if node.attr not in owner:
                raise ExpressionError(f"the table has no key {node.attr!r}")
            return owner[node.attr]
        raise ExpressionError(f"{node.attr!r} behind a dot is of {_kind(owner)}, which has no names")

    def _subscript(self, node: ast.Subscript, depth: int) -> Any:
        owner = self.data(node.value, depth)
        _require(isinstance(owner, str | list | dict), f"[ ] is of {_kind(owner)}")
        if isinstance(node.slice, ast.Slice):
            _require(not isinstance(owner, dict), "[ : ] is of a table")
            ends = (node.slice.lower, node.slice.upper, node.slice.step)
            return owner[slice(*(None if end is None else self.data(end, depth) for end in ends))]
        key = self.data(node.slice, depth)
        try:
            return owner[key]
        except KeyError:
            raise ExpressionError(f"the table has no key {key!r:.60}") from None

    def _binary(self, node: ast.BinOp, depth: int) -> Any:
        apply = _BINARY.get(type(node.op))
        if apply is None:
            raise ExpressionError(f"has {_words(node.op)}, which a robot's description may not")
        return plain(apply(self.data(node.left, depth), self.data(node.right, depth)), self._budget)

    def _unary(self, node: ast.UnaryOp, depth: int) -> Any:
        value = self.data(node.operand, depth)
        if isinstance(node.op, ast.Not):
            return not value
        apply = _UNARY.get(type(node.op))
        if apply is None or not _is_number(value):
            raise ExpressionError(f"has a sign before {_kind(value)}")
        return apply(value)

    def _boolean(self, node: ast.BoolOp, depth: int) -> Any:
        ends_at = isinstance(node.op, ast.Or)
        value: Any = None
        for part in node.values:
            value = self.data(part, depth)
            if bool(value) is ends_at:
                break
        return value

    def _compare(self, node: ast.Compare, depth: int) -> Any:
        left = self.data(node.left, depth)
        for kind, part in zip(node.ops, node.comparators, strict=True):
            right = self.data(part, depth)
            if not _COMPARISONS[type(kind)](left, right):
                return False
            left = right
        return True

    def _conditional(self, node: ast.IfExp, depth: int) -> Any:
        return self.data(node.body if self.data(node.test, depth) else node.orelse, depth)

    def _list(self, node: ast.List | ast.Tuple, depth: int) -> Any:
        return [self.data(part, depth) for part in node.elts]

    def _dict(self, node: ast.Dict, depth: int) -> Any:
        if any(key is None for key in node.keys):
            raise ExpressionError("has ** in a table")
        keys = [self.data(key, depth) for key in node.keys if key is not None]
        return plain(dict(zip(keys, (self.data(v, depth) for v in node.values), strict=True)), self._budget)

    def _comprehension(self, node: ast.ListComp | ast.GeneratorExp, depth: int) -> Any:
        made: list[Any] = []
        self._loop(node, 0, depth, made)
        return made

    def _loop(self, node: ast.ListComp | ast.GeneratorExp, level: int, depth: int, made: list[Any]) -> None:
        if level == len(node.generators):
            made.append(self.data(node.elt, depth))
            _require(len(made) <= MOST_ITEMS, "a list is too large")
            return
        loop = node.generators[level]
        if not isinstance(loop.target, ast.Name) or loop.is_async:
            raise ExpressionError("has a loop over other than one name")
        over, name, before = self.data(loop.iter, depth), loop.target.id, dict(self._local)
        _require(isinstance(over, str | list | dict), f"has a loop over {_kind(over)}")
        for item in over:
            self._local[name] = item
            if all(self.data(test, depth) for test in loop.ifs):
                self._loop(node, level + 1, depth, made)
        self._local = before

    def _call(self, node: ast.Call, depth: int) -> Any:
        if any(isinstance(part, ast.Starred) for part in node.args) or any(k.arg is None for k in node.keywords):
            raise ExpressionError("has * or ** in a call")
        call = self._callee(node.func, depth)
        if call is _mapped:
            function, *lists = node.args or [node.func]
            given = [self._callee(function, depth), *(self.data(part, depth) for part in lists)]
        else:
            given = [self.data(part, depth) for part in node.args]
        named = {str(part.arg): self.data(part.value, depth) for part in node.keywords}
        _require("key" not in named or call is _table, "takes a function for a value")
        self._budget.spend(sum(len(v) for v in given if isinstance(v, str | list | dict)) // 10)
        return plain(call(*given, **named), self._budget)

    def _callee(self, node: ast.AST, depth: int) -> Callable[..., Any]:
        if isinstance(node, ast.Attribute):
            owner = self.value(node.value, depth)
            methods = _METHODS.get(type(owner), {})
            if not isinstance(owner, Namespace):
                if node.attr not in methods:
                    raise ExpressionError(f"{node.attr!r} is no function of {_kind(owner)}")
                return lambda *given, **named: methods[node.attr](owner, *given, **named)
        function = self.value(node, depth)
        if not isinstance(function, Function):
            raise ExpressionError("calls what is no function")
        return function.call


_WALKS: Mapping[type[ast.AST], Callable[..., Any]] = {
    ast.Constant: _Evaluation._constant,
    ast.Name: _Evaluation._name,
    ast.Attribute: _Evaluation._attribute,
    ast.Subscript: _Evaluation._subscript,
    ast.BinOp: _Evaluation._binary,
    ast.UnaryOp: _Evaluation._unary,
    ast.BoolOp: _Evaluation._boolean,
    ast.Compare: _Evaluation._compare,
    ast.IfExp: _Evaluation._conditional,
    ast.List: _Evaluation._list,
    ast.Tuple: _Evaluation._list,
    ast.Dict: _Evaluation._dict,
    ast.ListComp: _Evaluation._comprehension,
    ast.GeneratorExp: _Evaluation._comprehension,
    ast.Call: _Evaluation._call,
}
_WORDS: Mapping[type[ast.AST], str] = {
    ast.Lambda: "a function of its own (lambda)",
    ast.NamedExpr: "an assignment (:=)",
    ast.JoinedStr: "a formatted text (f'...')",
    ast.Starred: "a *",
}


def _words(node: ast.AST) -> str:
    return _WORDS.get(type(node), f"{type(node).__name__}")
