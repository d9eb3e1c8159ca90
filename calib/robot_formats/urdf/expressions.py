"""Evaluation of a xacro's expressions by walking their syntax tree: arithmetic on plain data, never Python objects.

`ast.parse` makes the tree and runs nothing. Only what is listed here exists: an attribute is a key of a table or a
name of a namespace, never Python's; a call is one of a fixed set of functions on numbers, texts, lists and tables.
Sizes, depth and the number of steps are bounded.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

Plain: TypeAlias = "bool | int | float | str | list[Plain] | dict[Plain, Plain] | None"
"""A value that an expression may have; a tuple is read as a list."""
Value: TypeAlias = "Plain | Function | Namespace"
"""What a node of an expression may stand for before it is called or looked into."""

MOST_CHARACTERS = 20_000  # of an expression
MOST_DEPTH = 100  # of its tree
MOST_STEPS = 3_000_000  # of all expressions of a file together
MOST_TEXT = 1_000_000  # characters of a result
MOST_ITEMS = 100_000  # of a list or table, those within it counted
MOST_BITS = 1024  # of an integer: beyond any float


class ExpressionError(Exception):
    """An expression is not allowed, too large, or has no value."""


class NameTable(Protocol):
    """Table of the names that an expression may use; a missing name raises KeyError."""

    def __getitem__(self, name: str, /) -> object: ...


@dataclass(frozen=True)
class Function:
    """A function that an expression may call, and use for nothing else."""

    name: str
    call: Callable[..., object]


@dataclass(frozen=True)
class Namespace:
    """Names that are reached by a dot, as in `math.sin`."""

    names: NameTable


@dataclass
class Budget:
    """Number of evaluation steps that remain for all expressions of a file."""

    steps: int = field(default=MOST_STEPS)

    def spend(self, steps: int) -> None:
        self.steps -= steps
        if self.steps < 0:
            raise ExpressionError("the expressions of this file take too many steps")


def evaluate(text: str, names: NameTable, budget: Budget) -> Plain:
    """Value of an expression. Raises ExpressionError."""
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


def plain(value: object, budget: Budget) -> Plain:
    """A value copied as plain data of bounded size. Raises ExpressionError for anything else."""
    return _plain(value, budget, [0], 0)


def _plain(value: object, budget: Budget, count: list[int], depth: int) -> Plain:
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


def _numbers(left: Plain, right: Plain, sign: str) -> tuple[int | float, int | float]:
    """Both operands, which have to be numbers."""
    if isinstance(left, int | float) and isinstance(right, int | float):
        return left, right
    raise ExpressionError(f"{sign} takes numbers")


def _power(left: Plain, right: Plain) -> object:
    base, exponent = _numbers(left, right, "**")
    if isinstance(base, int) and isinstance(exponent, int) and exponent > 0:
        _require(base.bit_length() * exponent <= MOST_BITS, "an integer is too large")
    value = base**exponent
    _require(not isinstance(value, complex), "** has no real value here")
    return value


def _product(left: Plain, right: Plain) -> Plain:
    if isinstance(left, int | float) and isinstance(right, int | float):
        return left * right
    repeated, count = (right, left) if isinstance(left, int) else (left, right)
    if not isinstance(repeated, str | list) or type(count) is not int:
        raise ExpressionError("* takes numbers, or a text or list and an integer")
    most = MOST_TEXT if isinstance(repeated, str) else MOST_ITEMS
    _require(len(repeated) * max(count, 0) <= most, "a repeated text or list is too large")
    return repeated * count


def _remainder(left: Plain, right: Plain) -> Plain:
    if isinstance(left, str):
        places = re.findall(r"%[^%a-zA-Z]*[%a-zA-Z]?", left)
        _require(
            all(re.fullmatch(r"%%|%[-+ 0]?\d{0,2}(\.\d{1,2})?[sdfgeixX]", place) for place in places),
            "a format has other than %s %d %f %g %e %x, of at most two digits",
        )
        _require(not isinstance(right, dict), "a format takes no table")
        return left % (tuple(right) if isinstance(right, list) else right)
    one, other = _numbers(left, right, "%")
    return one % other


def _numeric(function: Callable[..., object], sign: str) -> Callable[[Plain, Plain], object]:
    """Operator made of a function of two numbers, which refuses other operands."""
    return lambda left, right: function(*_numbers(left, right, sign))


def _sum(left: Plain, right: Plain) -> Plain:
    if isinstance(left, int | float) and isinstance(right, int | float):
        return left + right
    if isinstance(left, str) and isinstance(right, str):
        return left + right
    if isinstance(left, list) and isinstance(right, list):
        return left + right
    raise ExpressionError(f"+ takes two numbers, two texts or two lists, not {_kind(left)} and {_kind(right)}")


_BINARY: Mapping[type[ast.operator], Callable[[Plain, Plain], object]] = {
    ast.Add: _sum,
    ast.Sub: _numeric(operator.sub, "-"),
    ast.Mult: _product,
    ast.Div: _numeric(operator.truediv, "/"),
    ast.FloorDiv: _numeric(operator.floordiv, "//"),
    ast.Mod: _remainder,
    ast.Pow: _power,
}
_UNARY: Mapping[type[ast.unaryop], Callable[[int | float], int | float]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_COMPARISONS: Mapping[type[ast.cmpop], Callable[..., object]] = {
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
    return kinds.get(type(value), "a number" if isinstance(value, int | float) else "no value")


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ExpressionError(message)


# ---- functions ------------------------------------------------------------------------------------------------------


def _integer(value: str | float = 0, base: int = 10) -> int:
    _require(not isinstance(value, str) or len(value) <= 400, "int() of a text of that length")
    if base == 10:
        return int(value)
    if not isinstance(value, str):
        raise ExpressionError("int() with a base takes a text")
    return int(value, base)


def _text(value: Plain = "") -> str:
    return str(value)


def _table(*start: Mapping[object, object] | Iterable[tuple[object, object]], **named: object) -> dict[object, object]:
    _require(len(start) <= 1, "dict() takes one list or table")
    table: dict[object, object] = dict(*start)
    table.update(named)
    return table


def _range(*ends: int) -> list[int]:
    _require(all(type(end) is int for end in ends) and 1 <= len(ends) <= 3, "range() takes one to three integers")
    numbers = range(*ends)
    _require(_length_of(numbers) <= MOST_ITEMS, "range() of so many")
    return list(numbers)


def _length_of(numbers: range) -> int:
    """Length of a range, also where `len` overflows."""
    span = numbers.stop - numbers.start
    return max(0, -(-span // numbers.step))


def _round(value: float, digits: float | None = None) -> float:
    if digits is None:
        return round(value)
    if not isinstance(digits, int) or abs(digits) > 300:
        raise ExpressionError("round() to so many digits")
    return round(value, digits)


def _mapped(function: Callable[..., object], *lists: Iterable[object]) -> list[object]:
    return [function(*items) for items in zip(*lists, strict=False)]


def _small(function: Callable[..., object], most: int) -> Callable[..., object]:
    """A function limited to arguments of a largest size, for functions whose results grow without bound."""

    def bounded(*values: object) -> object:
        small = all(isinstance(value, int | float) and abs(value) <= most for value in values)
        _require(small, f"numbers of at most {most} are needed")
        return function(*values)

    return bounded


_MATHS: dict[str, Function | float] = {
    name: Function(name, getattr(math, name))
    for name in (
        "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "ceil", "copysign", "cos", "cosh", "degrees",
        "dist", "erf", "erfc", "exp", "expm1", "fabs", "floor", "fmod", "fsum", "gamma", "gcd", "hypot", "isclose",
        "isfinite", "isinf", "isnan", "ldexp", "lgamma", "log", "log10", "log1p", "log2", "pow",
        "radians", "remainder", "sin", "sinh", "sqrt", "tan", "tanh", "trunc",
    )
}  # fmt: skip
MATHS: Mapping[str, Function | float] = (
    _MATHS
    | {name: Function(name, _small(getattr(math, name), 150)) for name in ("factorial", "comb", "perm")}
    | {name: getattr(math, name) for name in ("pi", "e", "tau", "inf", "nan")}
)


def _added(values: Iterable[Plain], start: Plain) -> Plain:
    total = start
    for value in values:
        total = _sum(total, value)
    return total


_BASICS: dict[str, Callable[..., object]] = {
    "list": lambda items=(): list(items), "dict": _table, "map": _mapped, "len": len, "str": _text,
    "float": lambda value=0.0: float(value),
    "int": _integer, "bool": lambda value=False: bool(value), "min": min, "max": max, "round": _round,
    "sorted": sorted, "range": _range, "abs": abs, "all": all, "any": any,
    "sum": lambda items, start=0: _added(items, start),
    "tuple": lambda items=(): list(items), "zip": lambda *lists: [list(row) for row in zip(*lists, strict=False)],
    "enumerate": lambda items, start=0: [list(row) for row in enumerate(items, start)],
    "reversed": lambda items: list(reversed(items)), "divmod": lambda left, right: list(divmod(left, right)),
}  # fmt: skip
BASICS: Mapping[str, Function | bool] = {
    **{name: Function(name, call) for name, call in _BASICS.items()},
    "True": True,
    "False": False,
}


def _replaced(text: str, old: Plain, new: Plain) -> str:
    if not isinstance(old, str) or not isinstance(new, str):
        raise ExpressionError("replace() takes texts")
    _require(len(text) + text.count(old) * len(new) <= MOST_TEXT, "a text is too large")
    return text.replace(old, new)


def _joined(between: str, texts: Iterable[str]) -> str:
    parts = list(texts)
    _require(sum(len(part) + len(between) for part in parts) <= MOST_TEXT, "a text is too large")
    return between.join(parts)


_METHODS: Mapping[type, Mapping[str, Callable[..., object]]] = {
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
    """Evaluation of one expression's tree, node by node."""

    def __init__(self, names: NameTable, budget: Budget) -> None:
        self._names, self._budget = names, budget
        self._local: dict[str, Plain] = {}  # variables of comprehensions

    def value(self, node: ast.AST, depth: int) -> Value:
        """Value of a syntax node; a function or a namespace too, where the node is called or has an attribute read."""
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

    def data(self, node: ast.AST, depth: int) -> Plain:
        """Value of a node that has to be plain data. Raises ExpressionError."""
        value = self.value(node, depth)
        if isinstance(value, Function | Namespace):
            raise ExpressionError("takes a function or a namespace for a value")
        return value

    def _constant(self, node: ast.Constant, depth: int) -> Plain:
        if not isinstance(node.value, str | int | float | None):
            raise ExpressionError("has a constant that is no number and no text")
        return plain(node.value, self._budget)

    def _name(self, node: ast.Name, depth: int) -> Value:
        if node.id in self._local:
            return self._local[node.id]
        try:
            return self._looked_up(self._names[node.id])
        except KeyError:
            raise ExpressionError(f"name {node.id!r} is not defined") from None

    def _looked_up(self, value: object) -> Value:
        return value if isinstance(value, Function | Namespace) else plain(value, self._budget)

    def _attribute(self, node: ast.Attribute, depth: int) -> Value:
        owner = self.value(node.value, depth)
        if isinstance(owner, Namespace):
            try:
                return self._looked_up(owner.names[node.attr])
            except KeyError:
                raise ExpressionError(f"name {node.attr!r} is not defined") from None
        if isinstance(owner, dict):
            if node.attr not in owner:
                raise ExpressionError(f"the table has no key {node.attr!r}")
            return owner[node.attr]
        raise ExpressionError(f"{node.attr!r} behind a dot is of {_kind(owner)}, which has no names")

    def _subscript(self, node: ast.Subscript, depth: int) -> Plain:
        owner = self.data(node.value, depth)
        if not isinstance(owner, str | list | dict):
            raise ExpressionError(f"[ ] is of {_kind(owner)}")
        if isinstance(node.slice, ast.Slice):
            if isinstance(owner, dict):
                raise ExpressionError("[ : ] is of a table")
            ends = (node.slice.lower, node.slice.upper, node.slice.step)
            return owner[slice(*(self._slice_end(end, depth) for end in ends))]
        key = self.data(node.slice, depth)
        if not isinstance(owner, dict):
            if not isinstance(key, int):
                raise ExpressionError(f"[ ] of {_kind(owner)} takes an integer")
            return owner[key]
        try:
            return owner[key]
        except KeyError:
            raise ExpressionError(f"the table has no key {key!r:.60}") from None

    def _slice_end(self, node: ast.AST | None, depth: int) -> int | None:
        end = None if node is None else self.data(node, depth)
        if end is not None and not isinstance(end, int):
            raise ExpressionError(f"[ : ] takes integers, not {_kind(end)}")
        return end

    def _binary(self, node: ast.BinOp, depth: int) -> Plain:
        apply = _BINARY.get(type(node.op))
        if apply is None:
            raise ExpressionError(f"has {_words(node.op)}, which a robot's description may not")
        return plain(apply(self.data(node.left, depth), self.data(node.right, depth)), self._budget)

    def _unary(self, node: ast.UnaryOp, depth: int) -> Plain:
        value = self.data(node.operand, depth)
        if isinstance(node.op, ast.Not):
            return not value
        apply = _UNARY.get(type(node.op))
        if apply is None or not isinstance(value, int | float):
            raise ExpressionError(f"has a sign before {_kind(value)}")
        return apply(value)

    def _boolean(self, node: ast.BoolOp, depth: int) -> Plain:
        ends_at = isinstance(node.op, ast.Or)
        value: Plain = None
        for part in node.values:
            value = self.data(part, depth)
            if bool(value) is ends_at:
                break
        return value

    def _compare(self, node: ast.Compare, depth: int) -> Plain:
        left = self.data(node.left, depth)
        for kind, part in zip(node.ops, node.comparators, strict=True):
            right = self.data(part, depth)
            if not _COMPARISONS[type(kind)](left, right):
                return False
            left = right
        return True

    def _conditional(self, node: ast.IfExp, depth: int) -> Plain:
        return self.data(node.body if self.data(node.test, depth) else node.orelse, depth)

    def _list(self, node: ast.List | ast.Tuple, depth: int) -> Plain:
        return [self.data(part, depth) for part in node.elts]

    def _dict(self, node: ast.Dict, depth: int) -> Plain:
        if any(key is None for key in node.keys):
            raise ExpressionError("has ** in a table")
        keys = [self.data(key, depth) for key in node.keys if key is not None]
        return plain(dict(zip(keys, (self.data(v, depth) for v in node.values), strict=True)), self._budget)

    def _comprehension(self, node: ast.ListComp | ast.GeneratorExp, depth: int) -> Plain:
        made: list[Plain] = []
        self._loop(node, 0, depth, made)
        return made

    def _loop(self, node: ast.ListComp | ast.GeneratorExp, level: int, depth: int, made: list[Plain]) -> None:
        if level == len(node.generators):
            made.append(self.data(node.elt, depth))
            _require(len(made) <= MOST_ITEMS, "a list is too large")
            return
        loop = node.generators[level]
        if not isinstance(loop.target, ast.Name) or loop.is_async:
            raise ExpressionError("has a loop over other than one name")
        over, name, before = self.data(loop.iter, depth), loop.target.id, dict(self._local)
        if not isinstance(over, str | list | dict):
            raise ExpressionError(f"has a loop over {_kind(over)}")
        for item in over:
            self._local[name] = item
            if all(self.data(test, depth) for test in loop.ifs):
                self._loop(node, level + 1, depth, made)
        self._local = before

    def _call(self, node: ast.Call, depth: int) -> Plain:
        if any(isinstance(part, ast.Starred) for part in node.args) or any(k.arg is None for k in node.keywords):
            raise ExpressionError("has * or ** in a call")
        call = self._callee(node.func, depth)
        if call is _mapped:
            function, *lists = node.args or [node.func]
            arguments: list[object] = [self._callee(function, depth), *(self.data(part, depth) for part in lists)]
        else:
            arguments = [self.data(part, depth) for part in node.args]
        named = {str(part.arg): self.data(part.value, depth) for part in node.keywords}
        _require("key" not in named or call is _table, "takes a function for a value")
        self._budget.spend(sum(len(v) for v in arguments if isinstance(v, str | list | dict)) // 10)
        return plain(call(*arguments, **named), self._budget)

    def _callee(self, node: ast.AST, depth: int) -> Callable[..., object]:
        if isinstance(node, ast.Attribute):
            owner = self.value(node.value, depth)
            methods = _METHODS.get(type(owner), {})
            if not isinstance(owner, Namespace):
                if node.attr not in methods:
                    raise ExpressionError(f"{node.attr!r} is no function of {_kind(owner)}")
                return lambda *arguments, **named: methods[node.attr](owner, *arguments, **named)
        function = self.value(node, depth)
        if not isinstance(function, Function):
            raise ExpressionError("calls what is no function")
        return function.call


_WALKS: Mapping[type[ast.AST], Callable[..., Value]] = {
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
