"""The statements of a Gmsh script: numbers, variables and lists are worked out, loops and commands are not run.

Nothing of Gmsh itself is called: a script can run any program (``SystemCall``), and a polygon file must not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from envs.polygons.rings import MOST_VERTICES
from envs.types import DomainError

TOKEN = re.compile(
    r"""(?P<space>\s+|//[^\n]*|/\*.*?(?:\*/|(?P<open>\Z)))
      | (?P<text>"[^"\n]*")
      | (?P<number>(?:\d+(?:\.(?!\.\.)\d*)?|\.\d+)(?:[eE][+-]?\d+)?)
      | (?P<name>[A-Za-z_]\w*)
      | (?P<sign>\.\.\.|\+=|-=|\*=|/=|[-+*/%^(){}\[\],;:=.<>!&|?~#@$'])""",
    re.VERBOSE | re.DOTALL,
)

FUNCTIONS: dict[str, Callable[..., float]] = {
    "Sin": math.sin, "Cos": math.cos, "Tan": math.tan, "Asin": math.asin, "Acos": math.acos, "Atan": math.atan,
    "Atan2": math.atan2, "Sqrt": math.sqrt, "Exp": math.exp, "Log": math.log, "Log10": math.log10, "Fabs": abs,
    "Abs": abs, "Floor": math.floor, "Ceil": math.ceil, "Round": round, "Hypot": math.hypot, "Min": min, "Max": max,
    "Sinh": math.sinh, "Cosh": math.cosh, "Tanh": math.tanh, "Fmod": math.fmod, "Modulo": math.fmod,
}  # fmt: skip

#: Parentheses in parentheses at most.
DEPTH = 50


class Token(NamedTuple):
    """A word of the script: its kind (a group of ``TOKEN``, or ``end``), its text and its line."""

    kind: str
    text: str
    line: int


def tokens(text: str, source: str) -> Iterator[Token]:
    """The words of a script, spaces and comments left out, and then one of kind ``end`` for ever."""
    at, line = 0, 1
    while at < len(text):
        match = TOKEN.match(text, at)
        if match is None:
            raise DomainError(f"{source}: line {line}: {text[at]!r} is not understood; correct it there")
        if match["open"] is not None:
            raise DomainError(f"{source}: line {line}: a comment that does not end; close it with */")
        word = match.group()
        if match.lastgroup != "space":
            yield Token(str(match.lastgroup), word, line)
        line += word.count("\n")
        at = match.end()
    while True:
        yield Token("end", "", line)


@dataclass
class Script:
    """A place in a script, and the variables set before it.

    Attributes:
        source: the name that messages begin with.
        words: its tokens from the next one on; read one by one, as there may be millions.
        next: the next one.
        depth: expressions in each other.
        ranged: numbers that ranges stood for so far.
        variables: numbers by name.
        counters: what ``newp`` and the like stand for, by name.
    """

    source: str
    words: Iterator[Token]
    next: Token = field(init=False)
    depth: int = 0
    ranged: float = 0.0
    variables: dict[str, float] = field(default_factory=dict)
    counters: dict[str, Callable[[], int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.next = next(self.words)

    def fault(self, what: str, line: int | None = None) -> DomainError:
        """The error for what is wrong on a line, without one at the next token."""
        return DomainError(f"{self.source}: line {line or self.next.line}: {what}")

    def take(self) -> Token:
        """The next token, passed."""
        token, self.next = self.next, next(self.words)
        return token

    def taken(self, text: str) -> bool:
        """Whether the next token is this one; then it is passed."""
        if self.next.text != text or self.next.kind in ("text", "end"):
            return False
        self.take()
        return True

    def expect(self, text: str) -> None:
        """Pass a token that must come here."""
        if not self.taken(text):
            raise self.fault(f"{self.next.text[:40]!r} where {text!r} is needed; correct the statement")

    def skip_statement(self) -> None:
        """Pass everything to the statement's end: its semicolon, or the brace that closes a block of statements."""
        open_braces, block = 0, False
        while (token := self.take()).kind != "end":
            open_braces += (token.text == "{") - (token.text == "}")
            if open_braces <= 0 and (token.text == ";" or (token.text == "}" and block)):
                return
            block = block or token.text == ";"

    def whole(self) -> int:
        """A whole number: a tag."""
        value = self.number()
        if not math.isfinite(value) or value != math.floor(value) or abs(value) > 2**53:
            raise self.fault(f"{value!r} where a whole number is needed; correct the statement")
        return int(value)

    def tags(self, opened: bool = False) -> list[int]:
        """A list of tags in braces, ``{1, 2, 5:8, -3}``, or one tag; ``opened``: behind the first brace."""
        values = self.numbers(opened) if opened or self.next.text == "{" else [self.number()]
        if not all(math.isfinite(v) and v == math.floor(v) and abs(v) < 2**53 for v in values):
            raise self.fault("a list of tags with a number that is not whole; correct the statement")
        return [int(value) for value in values]

    def numbers(self, opened: bool = False) -> list[float]:
        """A list of numbers in braces, ranges ``a:b``, ``a ... b`` and ``a:b:step`` written out; as
        `tags`."""
        if not opened:
            self.expect("{")
        values: list[float] = []
        while not self.taken("}"):
            first = self.number()
            if self.taken(":") or self.taken("..."):
                last = self.number()
                step = self.number() if self.taken(":") else math.copysign(1.0, last - first)
                values += self.stepped(first, last, step)
            else:
                values.append(first)
            if self.next.text != "}":
                self.expect(",")
        return values

    def stepped(self, first: float, last: float, step: float) -> Iterator[float]:
        """A range, its last value included."""
        self.ranged += abs((last - first) / step) if step else math.inf
        if not self.ranged <= MOST_VERTICES:
            what = f"a range from {first:g} to {last:g} by {step:g}"
            raise self.fault(f"{what}: more than {MOST_VERTICES:,} numbers in all ranges; use shorter ones")
        return (first + i * step for i in range(math.floor((last - first) / step + 1e-9) + 1))

    def number(self) -> float:
        """The value of an expression.

        Raises:
            DomainError: an unknown variable or function, or a value that cannot be worked out.
        """
        self.depth += 1
        if self.depth > DEPTH:
            raise self.fault(f"more than {DEPTH} parentheses in each other; simplify the expression")
        value = self.sum()
        self.depth -= 1
        return value

    def sum(self) -> float:
        """Terms added and subtracted."""
        value = self.product()
        while self.next.text in ("+", "-") and self.next.kind == "sign":
            value = value + self.product() if self.take().text == "+" else value - self.product()
        return value

    def product(self) -> float:
        """Factors multiplied and divided."""
        value = self.signed()
        while self.next.text in ("*", "/", "%") and self.next.kind == "sign":
            operator = self.take().text
            factor = self.signed()
            if operator != "*" and factor == 0.0:
                raise self.fault("a division by zero; correct the expression")
            value = (
                value * factor if operator == "*" else value / factor if operator == "/" else math.fmod(value, factor)
            )
        return value

    def signed(self) -> float:
        """A power with any number of signs before it."""
        sign = 1.0
        while self.next.text in ("-", "+") and self.next.kind == "sign":
            sign = -sign if self.take().text == "-" else sign
        return sign * self.power()

    def power(self) -> float:
        """A value, raised to another."""
        base = self.value()
        if not self.taken("^"):
            return base
        self.depth += 1
        if self.depth > DEPTH:
            raise self.fault("a tower of powers; simplify the expression")
        exponent = self.signed()
        self.depth -= 1
        return self.worked_out(math.pow, [base, exponent])

    def value(self) -> float:
        """A number, a variable, a function's value or an expression in parentheses."""
        if self.taken("("):
            value = self.number()
            self.expect(")")
            return value
        token = self.take()
        if token.kind == "number":
            return float(token.text)
        if token.kind == "name":
            return self.named(token.text)
        raise self.fault(f"{token.text[:40]!r} where a number is needed; correct the expression", token.line)

    def named(self, name: str) -> float:
        """What a name stands for."""
        if name in FUNCTIONS and self.next.text in ("(", "["):
            closing = ")" if self.take().text == "(" else "]"
            arguments = [self.number()]
            while self.taken(","):
                arguments.append(self.number())
            self.expect(closing)
            return self.worked_out(FUNCTIONS[name], arguments)
        if name == "Pi":
            return math.pi
        if name in self.counters:
            return float(self.counters[name]())
        if name in self.variables:
            return self.variables[name]
        raise self.fault(f"{name[:40]!r} is no number known here; set it before, or open the file in Gmsh, save a .msh")

    def worked_out(self, function: Callable[..., float], arguments: list[float]) -> float:
        """A function's value."""
        try:
            return float(function(*arguments))
        except (ValueError, OverflowError, TypeError, ZeroDivisionError) as error:
            raise self.fault(f"cannot be worked out ({error}); correct the expression") from None
