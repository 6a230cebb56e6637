"""Sizes by an expression in x and y, as ``0.1 + 0.2 * hypot(x - 1, y)``: read by Python's grammar, never run by it."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np

from envs.errors import UserError
from envs.polygons.size_cells import Size
from envs.readers.file_check import excerpt
from envs.types import Floats

#: Characters at most, and operations inside each other.
MOST_CHARACTERS, DEPTH = 10_000, 100

CONSTANTS = {"pi": np.pi, "e": np.e}

#: Functions, and how many arguments each takes at least and at most.
FUNCTIONS: dict[str, tuple[Callable[..., Any], int, int]] = {
    **{
        name: (getattr(np, name), 1, 1)
        for name in ("sqrt", "exp", "log", "log10", "sin", "cos", "tan", "sinh", "cosh", "tanh", "abs", "floor", "ceil")
    },
    "asin": (np.arcsin, 1, 1), "acos": (np.arccos, 1, 1), "atan": (np.arctan, 1, 1), "atan2": (np.arctan2, 2, 2),
    "hypot": (np.hypot, 2, 2),
    "min": (lambda *values: np.minimum.reduce(np.broadcast_arrays(*values)), 2, 100),
    "max": (lambda *values: np.maximum.reduce(np.broadcast_arrays(*values)), 2, 100),
}  # fmt: skip

OPERATORS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Mod: np.mod,
    ast.Pow: np.power, ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater, ast.GtE: np.greater_equal,
    ast.Eq: np.equal, ast.NotEq: np.not_equal,
}  # fmt: skip


def expression(text: str) -> Size:
    """The size that an expression says.

    Args:
        text: of numbers, ``x``, ``y``, the ``CONSTANTS`` and ``FUNCTIONS``, ``+ - * / % **``, parentheses, and
            ``a if x < 1 else b`` with comparisons, ``and``, ``or`` and ``not``.

    Returns:
        A function of (m, 2) places to (m,) sizes, which raises `UserError` where one is no positive number.

    Raises:
        UserError: what is not understood, with its column.
    """
    name = f"size {excerpt(text)!r}"
    if len(text) > MOST_CHARACTERS:
        raise UserError(f"{name}: {len(text):,} characters, at most {MOST_CHARACTERS:,} are read; give a file")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except SyntaxError as error:
        raise UserError(f"{name}: column {error.offset or 1}: not understood; give an expression in x and y") from None
    except (ValueError, RecursionError, MemoryError):
        raise UserError(f"{name}: not understood; give a short expression in x and y") from None
    check(tree, name, 0)

    def size(places: Floats) -> Floats:
        with np.errstate(all="ignore"):
            found = np.broadcast_to(np.asarray(value(tree, *places.T), dtype=np.float64), (len(places),))
        wrong = np.flatnonzero(~(np.isfinite(found) & (found > 0.0)))
        if len(wrong):
            x, y = places[wrong[0]]
            raise UserError(f"{name}: {found[wrong[0]]:g} at ({x:g}, {y:g}); give a size above 0 all over the domain")
        return found

    return size


def check(node: ast.AST, name: str, depth: int) -> None:
    """Refuse what is not of the small language, before anything is worked out."""

    def refuse(what: str) -> NoReturn:
        raise UserError(f"{name}: column {getattr(node, 'col_offset', 0) + 1}: {what}")

    if depth > DEPTH:
        refuse(f"more than {DEPTH} operations in each other; simplify it")
    inner: list[ast.AST] = []
    match node:
        case ast.Constant(value=bool() | complex()) | ast.Constant(value=str() | bytes() | None):
            refuse("no number; give numbers, x and y")
        case ast.Constant(value=int() | float() as number):
            if number > 1e300:
                refuse("a number above 1e300; give a smaller one")
        case ast.Name(id=known):
            if known not in ("x", "y", *CONSTANTS):
                refuse(f"{excerpt(known)!r} is not known; there are x, y, {', '.join((*CONSTANTS, *FUNCTIONS))}")
        case ast.BinOp(left=left, op=operator, right=right):
            if isinstance(operator, ast.BitXor):
                refuse("^ is no power here; write **")
            if type(operator) not in OPERATORS:
                refuse("an operator that is not known; there are + - * / % **")
            inner = [left, right]
        case ast.UnaryOp(op=ast.UAdd() | ast.USub() | ast.Not(), operand=operand):
            inner = [operand]
        case ast.Compare(left=left, ops=operators, comparators=others):
            if any(type(operator) not in OPERATORS for operator in operators):
                refuse("a comparison that is not known; there are < <= > >= == !=")
            inner = [left, *others]
        case ast.BoolOp(values=values):
            inner = list(values)
        case ast.IfExp(test=test, body=body, orelse=otherwise):
            inner = [test, body, otherwise]
        case ast.Call(func=ast.Name(id=called), args=arguments, keywords=[]):
            if called not in FUNCTIONS:
                refuse(f"{excerpt(called)!r} is no function known here; there are {', '.join(FUNCTIONS)}")
            _, least, most = FUNCTIONS[called]
            if not least <= len(arguments) <= most:
                wanted = f"{least}" if least == most else f"{least} or more"
                refuse(f"{called} takes {wanted} arguments, not {len(arguments)}")
            inner = list(arguments)
        case _:
            refuse("not understood; give an expression in x and y, of numbers and functions")
    for one in inner:
        check(one, name, depth + 1)


def value(node: ast.AST, x: Floats, y: Floats) -> Any:
    """What a checked expression is worth at places."""

    def of(inner: ast.AST) -> Any:
        return value(inner, x, y)

    match node:
        case ast.Constant(value=number):
            return float(number)  # type: ignore[arg-type]
        case ast.Name(id=known):
            return {"x": x, "y": y, **CONSTANTS}[known]
        case ast.BinOp(left=left, op=operator, right=right):
            return OPERATORS[type(operator)](of(left), of(right))
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return np.logical_not(of(operand))
        case ast.UnaryOp(op=operator, operand=operand):
            return -of(operand) if isinstance(operator, ast.USub) else of(operand)
        case ast.Compare(left=left, ops=operators, comparators=others):
            values = [of(left), *(of(other) for other in others)]
            pairs = zip(operators, values[:-1], values[1:], strict=True)
            return np.logical_and.reduce([OPERATORS[type(operator)](a, b) + 0.0 * x != 0.0 for operator, a, b in pairs])
        case ast.BoolOp(op=operator, values=parts):
            joined = np.logical_and if isinstance(operator, ast.And) else np.logical_or
            return joined.reduce(np.broadcast_arrays(*(of(part) for part in parts)))
        case ast.IfExp(test=test, body=body, orelse=otherwise):
            return np.where(of(test), of(body), of(otherwise))
        case ast.Call(func=ast.Name(id=called), args=arguments):
            return FUNCTIONS[called][0](*(of(argument) for argument in arguments))
    raise AssertionError(node)  # check() knows no other
