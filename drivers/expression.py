"""Arithmetic in device maps, such as ``"i_nom/52428"``: numbers, named constants, ``+ - * /`` and brackets.

A map is data that a user may get from somebody else, so it is parsed into a tree of which every node is on a
list, and walked; it is never handed to the interpreter.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

MAX_LENGTH = 200
_BINARY: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_UNARY: Mapping[type[ast.unaryop], Callable[[float], float]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}


class ExpressionError(ValueError):
    """An expression that is not allowed, or that has no finite value."""


@dataclass(frozen=True, slots=True)
class Expression:
    """A checked expression; `names` are the constants that it needs."""

    text: str
    names: frozenset[str]
    _tree: ast.expr = field(repr=False, compare=False)

    def evaluate(self, constants: Mapping[str, float]) -> float:
        """Value of the expression with the given constants.

        Raises
        ------
        ExpressionError
            If a constant is missing, or if the value is not finite.
        """
        try:
            value = _value(self._tree, constants)
        except KeyError as error:
            raise ExpressionError(f"'{self.text}' needs {error}, which is not among the constants") from None
        except ZeroDivisionError:
            raise ExpressionError(f"'{self.text}' divides by zero") from None
        if not math.isfinite(value):
            raise ExpressionError(f"'{self.text}' is {value}, not a finite number")
        return value


def parse_expression(text: str) -> Expression:
    """Check an expression against the list of what is allowed.

    Raises
    ------
    ExpressionError
        If it is too long, is no expression, or uses anything but numbers, names, ``+ - * /`` and brackets.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"longer than {MAX_LENGTH} characters")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ExpressionError(f"'{text}' is not an arithmetic expression") from None
    names: set[str] = set()
    _check(tree, text, names)
    return Expression(text, frozenset(names), tree)


def _check(node: ast.expr, text: str, names: set[str]) -> None:
    """Refuse every node that is not on the list; collect the names."""
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        _check(node.left, text, names)
        _check(node.right, text, names)
    elif isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
        _check(node.operand, text, names)
    elif isinstance(node, ast.Name):
        names.add(node.id)
    elif not (isinstance(node, ast.Constant) and type(node.value) in (int, float)):
        raise ExpressionError(f"'{text}': {type(node).__name__} is not allowed; only numbers, names, + - * / ( )")


def _value(node: ast.expr, constants: Mapping[str, float]) -> float:
    """Walk a tree that `_check` has passed."""
    if isinstance(node, ast.BinOp):
        return _BINARY[type(node.op)](_value(node.left, constants), _value(node.right, constants))
    if isinstance(node, ast.UnaryOp):
        return _UNARY[type(node.op)](_value(node.operand, constants))
    if isinstance(node, ast.Name):
        return constants[node.id]
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        try:
            return float(node.value)
        except OverflowError:
            return math.inf
    raise ExpressionError(f"{type(node).__name__} is not allowed")
