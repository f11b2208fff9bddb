"""Evaluation of xacro's expressions, `${...}`, by a parser of arithmetic: no Python code runs.

A robot's file comes from anyone. Its expressions know numbers, strings, lists, dicts, names,
arithmetic, comparisons, `a if c else b`, indices, the functions of `FUNCTIONS` and a few methods of
strings and dicts. Nothing of Python's objects can be reached: a dot looks up a key of a dict.
"""

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

LONGEST_EXPRESSION: Final = 4000  # characters
LONGEST_STRING: Final = 4000  # characters of a string
LARGEST_COLLECTION: Final = 1000  # items of a list that an expression makes
LARGEST_BITS: Final = 1024  # of an integer; a float holds no more either
_LEAVES: Final = 10_000  # numbers and strings in a value with all that it holds
_BOUNDED: Final = frozenset({int, str, list, tuple, dict})


class ExpressionError(ValueError):
    """An expression that xacro's arithmetic does not know, or that has no bounded value."""


@dataclass
class Work:
    """The work that a document may still cause: an attack by repetition ends here.

    Attributes:
        units_left: about a microsecond each.
    """

    units_left: int

    def spend(self, units: int) -> None:
        """Counts work about to be done.

        Raises:
            ExpressionError: the document has had its share.
        """
        self.units_left -= units
        if self.units_left < 0:
            raise ExpressionError("the document takes too much work")


def evaluate(expression: str, names: Mapping[str, Any], work: Work) -> Any:
    """Returns the value of an expression.

    Args:
        names: the properties, and namespaces of them.

    Raises:
        ExpressionError: it is no expression, holds what is not arithmetic, or has no value.
    """
    if len(expression) > LONGEST_EXPRESSION:
        raise ExpressionError(f"is longer than {LONGEST_EXPRESSION} characters")
    try:
        tree = ast.parse(expression.strip(), mode="eval")
        return _Evaluator(names, work).value(tree.body)
    except (SyntaxError, MemoryError, RecursionError) as error:
        raise ExpressionError("is no expression that can be read") from error
    except ExpressionError:
        raise
    # Of numbers and collections alone: a missing key, a division by zero, two types that do not fit
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise ExpressionError(" ".join(str(error).split()) or type(error).__name__) from error


def bounded(value: Any) -> Any:
    """Returns a value that is numbers, strings, lists and dicts, and not too many.

    Raises:
        ExpressionError: it is something else, or too large.
    """
    stack, leaves_left = [value], _LEAVES
    while stack:
        item = stack.pop()
        leaves_left -= 1
        if leaves_left < 0:
            raise ExpressionError("the value is too large")
        if isinstance(item, str):
            if len(item) > LONGEST_STRING:
                raise ExpressionError(f"a string of more than {LONGEST_STRING} characters")
        elif isinstance(item, int):
            if item.bit_length() > LARGEST_BITS:
                raise ExpressionError("the number is too large")
        elif isinstance(item, list | tuple):
            stack.extend(item[: leaves_left + 1])
        elif isinstance(item, dict):
            stack.extend(key for key, _ in zip(item, range(leaves_left + 1), strict=False))
            stack.extend(dict.__getitem__(item, key) for key in list(item)[: leaves_left + 1])
        elif item is not None and not isinstance(item, float):
            raise ExpressionError(f"the value is a {type(item).__name__}")
    return value


def _power(base: Any, exponent: Any) -> Any:
    if isinstance(base, int) and isinstance(exponent, int) and exponent > 0:
        if exponent * base.bit_length() > LARGEST_BITS:
            raise ExpressionError("the number is too large")
    elif not (isinstance(base, int | float) and isinstance(exponent, int | float)):
        raise ExpressionError("** needs numbers")
    power = base**exponent
    if isinstance(power, complex):
        raise ExpressionError("a root of a negative number")
    return power


def _product(first: Any, second: Any) -> Any:
    for sequence, times in ((first, second), (second, first)):
        if isinstance(sequence, str | list | tuple):
            limit = LONGEST_STRING if isinstance(sequence, str) else LARGEST_COLLECTION
            if not isinstance(times, int) or len(sequence) * times > limit:
                raise ExpressionError("repeated too often")
    return first * second


def _remainder(dividend: Any, divisor: Any) -> Any:
    if not (isinstance(dividend, int | float) and isinstance(divisor, int | float)):
        raise ExpressionError("% needs numbers")
    return dividend % divisor


def _range(*limits: int) -> list[int]:
    numbers = range(*limits)
    if len(numbers) > LARGEST_COLLECTION:
        raise ExpressionError(f"a range of more than {LARGEST_COLLECTION} numbers")
    return list(numbers)


def _round(number: float, digits: int = 0) -> float:
    if not -20 <= digits <= 20:
        raise ExpressionError("round to at most 20 digits")
    return round(number, digits) if digits else round(number)


_MATH: Final[dict[str, Any]] = {
    **{name: getattr(math, name) for name in ("e", "inf", "nan", "pi", "tau")},
    **{f.__name__: f for f in (math.acos, math.acosh, math.asin, math.asinh, math.atan)},
    **{f.__name__: f for f in (math.atan2, math.atanh, math.ceil, math.copysign, math.cos)},
    **{f.__name__: f for f in (math.cosh, math.degrees, math.exp, math.fabs, math.floor)},
    **{f.__name__: f for f in (math.fmod, math.fsum, math.hypot, math.isfinite, math.isinf)},
    **{f.__name__: f for f in (math.isnan, math.log, math.log10, math.log2, math.radians)},
    **{f.__name__: f for f in (math.sin, math.sinh, math.sqrt, math.tan, math.tanh, math.trunc)},
    "pow": _power,
}
_PYTHON: Final[dict[str, Any]] = {
    "True": True,
    "False": False,
    "None": None,
    "range": _range,
    "round": _round,
    **{f.__name__: f for f in (abs, all, any, bool, dict, float, int, len, list, max, min)},
    **{f.__name__: f for f in (sorted, str, sum, tuple)},
}


class Namespace(dict[str, Any]):
    """Functions and constants behind a dot: `math.pi`."""


FUNCTIONS: Final[Mapping[str, Any]] = {
    **_MATH,
    **_PYTHON,
    "math": Namespace(_MATH),
    "python": Namespace(_PYTHON),
}

_STRING_METHODS: Final = frozenset(
    {"endswith", "find", "isdigit", "join", "lower", "lstrip", "replace", "rstrip"}
    | {"split", "startswith", "strip", "upper"}
)
_DICT_METHODS: Final = frozenset({"get", "items", "keys", "values"})
_BINARY: Final[dict[type[ast.operator], Callable[[Any, Any], Any]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: _product,
    ast.Pow: _power,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: _remainder,
}
_UNARY: Final[dict[type[ast.unaryop], Callable[[Any], Any]]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
}
_COMPARISON: Final[dict[type[ast.cmpop], Callable[[Any, Any], Any]]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
}


class _Evaluator:
    """Walks over an expression's tree; one method a kind of node."""

    def __init__(self, names: Mapping[str, Any], work: Work) -> None:
        self._names = names
        self._work = work

    def value(self, node: ast.expr) -> Any:
        self._work.spend(5)
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise ExpressionError(f"{type(node).__name__} is no arithmetic of xacro")
        value = method(node)
        if type(value) in _BOUNDED:
            self._work.spend(_size(value))
            bounded(value)
        return value

    def _constant(self, node: ast.Constant) -> Any:
        if isinstance(node.value, bytes | complex) or node.value is ...:
            raise ExpressionError(f"{type(node.value).__name__} is no arithmetic of xacro")
        return node.value

    def _name(self, node: ast.Name) -> Any:
        try:
            return self._names[node.id]
        except KeyError:
            raise ExpressionError(f"name '{node.id}' is not defined") from None

    def _binop(self, node: ast.BinOp) -> Any:
        if type(node.op) not in _BINARY:
            raise ExpressionError(f"{type(node.op).__name__} is no arithmetic of xacro")
        return _BINARY[type(node.op)](self.value(node.left), self.value(node.right))

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        if type(node.op) not in _UNARY:
            raise ExpressionError(f"{type(node.op).__name__} is no arithmetic of xacro")
        return _UNARY[type(node.op)](self.value(node.operand))

    def _boolop(self, node: ast.BoolOp) -> Any:
        stops_at = isinstance(node.op, ast.Or)
        value: Any = None
        for operand in node.values:
            value = self.value(operand)
            if bool(value) is stops_at:
                break
        return value

    def _compare(self, node: ast.Compare) -> Any:
        first, result = self.value(node.left), True
        for kind, operand in zip(node.ops, node.comparators, strict=True):
            second = self.value(operand)
            self._work.spend(_size(second))
            result = _COMPARISON[type(kind)](first, second)
            if not result:
                break
            first = second
        return result

    def _ifexp(self, node: ast.IfExp) -> Any:
        return self.value(node.body if self.value(node.test) else node.orelse)

    def _list(self, node: ast.List) -> Any:
        return [self.value(item) for item in node.elts]

    def _tuple(self, node: ast.Tuple) -> Any:
        return tuple(self.value(item) for item in node.elts)

    def _dict(self, node: ast.Dict) -> Any:
        if None in node.keys:
            raise ExpressionError("** is no arithmetic of xacro")
        return {
            self.value(key): self.value(value)
            for key, value in zip(node.keys, node.values, strict=True)
            if key is not None
        }

    def _subscript(self, node: ast.Subscript) -> Any:
        collection = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            lower, upper, step = (
                None if bound is None else self.value(bound)
                for bound in (node.slice.lower, node.slice.upper, node.slice.step)
            )
            return collection[lower:upper:step]
        return collection[self.value(node.slice)]

    def _attribute(self, node: ast.Attribute) -> Any:
        """A key of a dict, as xacro gives those of YAML, or one of a few methods."""
        owner, name = self.value(node.value), node.attr
        if isinstance(owner, dict) and name in owner:
            return owner[name]
        if type(owner) is dict and name in _DICT_METHODS:
            return _listing(getattr(owner, name)) if name != "get" else owner.get
        if type(owner) is str and name in _STRING_METHODS:
            return getattr(owner, name)
        raise ExpressionError(f"'{name}' is not defined")

    def _call(self, node: ast.Call) -> Any:
        function = self.value(node.func)
        if not callable(function):
            raise ExpressionError("what is called is no function")
        arguments = [self.value(argument) for argument in node.args]
        keywords = {k.arg: self.value(k.value) for k in node.keywords if k.arg is not None}
        if len(keywords) < len(node.keywords) or (keywords and function is not dict):
            raise ExpressionError("arguments by name are no arithmetic of xacro")
        self._work.spend(sum(map(_size, (function, *arguments))))
        return function(*arguments, **keywords)


def _size(value: Any) -> int:
    """About how many items a function has to go through in an argument."""
    if isinstance(value, str):
        return len(value) // 10
    return len(value) if isinstance(value, list | tuple | dict) else 1


def _listing(method: Callable[[], Any]) -> Callable[[], list[Any]]:
    return lambda: list(method())
