"""The expressions of a Gmsh script, worked out: numbers, lists and texts, and the variables that hold them.

Nothing of Gmsh itself is called: a script can run any program (``SystemCall``), and a polygon file must not.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterator

from envs.polygons.rings import MOST_VERTICES
from envs.readers.geo_passed_over import OPTIONS
from envs.readers.geo_words import Mark, NotReadError, Words

FUNCTIONS: dict[str, Callable[..., float]] = {
    "Sin": math.sin, "Cos": math.cos, "Tan": math.tan, "Asin": math.asin, "Acos": math.acos, "Atan": math.atan,
    "Atan2": math.atan2, "Sqrt": math.sqrt, "Exp": math.exp, "Log": math.log, "Log10": math.log10, "Fabs": abs,
    "Abs": abs, "Floor": math.floor, "Ceil": math.ceil, "Round": lambda x: math.floor(x + 0.5), "Hypot": math.hypot,
    "Min": min, "Max": max, "Sinh": math.sinh, "Cosh": math.cosh, "Tanh": math.tanh, "Fmod": math.fmod,
    "Modulo": math.fmod, "ArcCos": math.acos, "ArcSin": math.asin, "ArcTan": math.atan, "ArcTan2": math.atan2,
    "Step": lambda x: float(x >= 0.0),
}  # fmt: skip

#: What stands between two numbers, the more tightly the later its row.
OPERATORS: dict[str, tuple[int, Callable[[float, float], float]]] = {
    sign: (tightness, work)
    for tightness, row in enumerate((
        {"||": lambda a, b: float(bool(a) or bool(b))},
        {"&&": lambda a, b: float(bool(a) and bool(b))},
        {"==": operator.eq, "!=": operator.ne},
        {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge},
        {"+": operator.add, "-": operator.sub},
        {"*": operator.mul, "/": operator.truediv, "%": math.fmod},
    ))
    for sign, work in row.items()
}  # fmt: skip

#: What gives a text, other than a text itself and a variable.
TEXT_FUNCTIONS = ("Str", "StrCat", "Sprintf")

#: What a text may say of how a number is written in it.
FORMAT = re.compile(r"%[-+ 0]?\d{0,2}(?:\.\d{1,2})?l?([dgfeiu])|%%")

CLOSING = {"(": ")", "[": "]", "{": "}"}

#: Parentheses, blocks, macros and included files in each other at most.
DEPTH = 50

#: Numbers in lists at most, those of variables counted each time that they are used.
MOST_LISTED = 3_000_000

#: Letters of a text at most.
MOST_LETTERS = 1000

#: A number, or a list of numbers.
Value = float | list[float]


class Script(Words):
    """A script being read.

    Attributes:
        depth: expressions in each other.
        ranged: numbers that ranges stood for so far.
        listed: numbers that lists held so far.
        variables: numbers by name; one alone is a list of one.
        texts: texts by name.
        counters: what ``newp`` and the like stand for, by name.
        queries: what gives a list of its own syntax, ``Boundary`` or ``Point``, by its name, which was passed.
        macros: where their statements begin, by name.
        ended: whether an ``Exit`` was read.
    """

    def __init__(self, text: str, source: str) -> None:
        self.depth = 0
        self.ranged = 0.0
        self.listed = 0
        self.variables: dict[str, list[float]] = {}
        self.texts: dict[str, str] = {}
        self.counters: dict[str, Callable[[], int]] = {}
        self.queries: dict[str, Callable[[], list[float]]] = {}
        self.macros: dict[str, Mark] = {}
        self.ended = False
        super().__init__(text, source)

    def whole(self) -> int:
        """A whole number: a tag."""
        value = self.number()
        if not math.isfinite(value) or value != math.floor(value) or abs(value) > 2**53:
            raise self.fault(f"{value!r} where a whole number is needed; correct the statement")
        return int(value)

    def tags(self, opened: bool = False) -> list[int]:
        """A list of tags in braces, ``{1, 2, 5:8, -3}``, or an item of one; ``opened``: behind the first brace."""
        return self.as_tags(self.numbers(opened) if opened or self.next.text == "{" else self.item())

    def as_tags(self, values: list[float]) -> list[int]:
        """The numbers, all of them whole."""
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
            values += self.item()
            if self.next.text != "}":
                self.expect(",")
        return values

    def item(self) -> list[float]:
        """What stands between two commas of a list: a number, a range, a list."""
        first = self.expression()
        if isinstance(first, list):
            return self.counted(first)
        if not (self.taken(":") or self.taken("...")):
            return [first]
        last = self.number()
        step = self.number() if self.taken(":") or self.taken("...") else math.copysign(1.0, last - first)
        return list(self.stepped(first, last, step))

    def counted(self, values: list[float]) -> list[float]:
        """The list, as one more of those that were used."""
        self.listed += len(values)
        if self.listed > MOST_LISTED:
            raise self.fault(f"more than {MOST_LISTED:,} numbers in all lists; use shorter ones")
        return values

    def stepped(self, first: float, last: float, step: float) -> Iterator[float]:
        """A range, its last value included."""
        self.ranged += abs((last - first) / step) if step else math.inf
        if not self.ranged <= MOST_VERTICES:
            what = f"a range from {first:g} to {last:g} by {step:g}"
            raise self.fault(f"{what}: more than {MOST_VERTICES:,} numbers in all ranges; use shorter ones")
        return (first + i * step for i in range(math.floor((last - first) / step + 1e-9) + 1))

    def number(self) -> float:
        """The value of an expression that is one number.

        Raises:
            DomainError: an unknown variable or function, or a value that cannot be worked out.
        """
        value = self.expression()
        if isinstance(value, list):
            raise self.fault("a list where a number is needed; correct the expression")
        return value

    def expression(self) -> Value:
        """The value of an expression."""
        self.deeper("more than {} parentheses in each other; simplify the expression")
        value = self.joined(0)
        if not isinstance(value, list) and self.taken("?"):
            chosen, condition = self.number(), value
            self.expect(":")
            other = self.number()
            value = math.nan if math.isnan(condition) else chosen if condition else other
        self.depth -= 1
        return value

    def deeper(self, what: str) -> None:
        """One expression more in another."""
        self.depth += 1
        if self.depth > DEPTH:
            raise self.fault(what.format(DEPTH))

    def joined(self, least: int) -> Value:
        """Values joined by operators of a tightness and more."""
        value = self.signed()
        while self.next.kind == "sign" and (found := OPERATORS.get(self.next.text)) and found[0] >= least:
            sign = self.take().text
            other = self.joined(found[0] + 1)
            if isinstance(value, list) or isinstance(other, list):
                value = self.scaled(value, sign, other)
                continue
            if sign in ("/", "%") and other == 0.0:
                raise self.fault("a division by zero; correct the expression")
            unknown = math.isnan(value) or math.isnan(other)
            value = math.nan if unknown else self.worked_out(found[1], [value, other])
        return value

    def scaled(self, factor: Value, sign: str, values: Value) -> list[float]:
        """A number times a list."""
        if sign != "*" or isinstance(factor, list) or not isinstance(values, list):
            raise self.fault(f"a list before or after {sign!r}; write a number times a list")
        return [factor * value for value in self.counted(values)]

    def signed(self) -> Value:
        """A power with any number of signs before it."""
        signs = []
        while self.next.text in ("-", "+", "!") and self.next.kind == "sign":
            signs.append(self.take().text)
        value = self.power()
        for sign in reversed(signs):
            if isinstance(value, list):
                value = self.scaled(-1.0 if sign == "-" else 1.0, "*", value)
            else:
                value = float(not value) if sign == "!" else -value if sign == "-" else value
        return value

    def power(self) -> Value:
        """A value, raised to another."""
        base = self.value()
        if isinstance(base, list) or not self.taken("^"):
            return base
        self.deeper("a tower of powers; simplify the expression")
        exponent = self.signed()
        if isinstance(exponent, list):
            raise self.fault("a list where a number is needed; correct the expression")
        self.depth -= 1
        return self.worked_out(math.pow, [base, exponent])

    def value(self) -> Value:
        """A number, a variable, a function's value, a list, or an expression in parentheses."""
        if self.taken("("):
            value = self.expression()
            self.expect(")")
            return value
        if self.next.text == "{" and self.next.kind == "sign":
            return self.numbers()
        token = self.take()
        if token.kind == "number":
            return float(token.text)
        if token.kind == "name":
            return self.named(token.text)
        if token.text == "#" and self.next.kind == "name":
            return float(len(self.list_of(self.variable_name())))
        raise self.fault(f"{token.text[:40]!r} where a number is needed; correct the expression", token.line)

    def named(self, name: str) -> Value:
        """What a name stands for, which was passed."""
        if name in FUNCTIONS and self.next.text in ("(", "["):
            closing = CLOSING[self.take().text]
            arguments = [self.number()]
            while self.taken(","):
                arguments.append(self.number())
            self.expect(closing)
            return self.worked_out(FUNCTIONS[name], arguments)
        if name == "Pi":
            return math.pi
        if name in OPTIONS and self.next.text in (".", "["):
            return self.option()
        if name in self.counters:
            return float(self.counters[name]())
        if name in self.queries:
            return self.counted(self.queries[name]())
        if name == "Exists":
            return self.exists()
        if name in ("LinSpace", "Unique", "List"):
            return self.made_list(name)
        if name == "DefineNumber":
            return self.defined_number()
        return self.variable(self.variable_name(name))

    def option(self) -> float:
        """The value of an option of Gmsh's: not a number, as it is not known here."""
        if self.taken("["):
            self.number()
            self.expect("]")
        while self.taken("."):
            self.take()
        return math.nan

    def exists(self) -> float:
        """``Exists(name)``: whether a variable is set."""
        closing = CLOSING.get(self.take().text, ")")
        name = self.variable_name()
        self.expect(closing)
        return float(name in self.variables or name in self.texts)

    def defined_number(self) -> float:
        """``DefineNumber[value, Name "..."]``."""
        closing = CLOSING.get(self.take().text, ")")
        value = self.number()
        depth = 0
        while depth or self.next.text != closing:
            token = self.take()
            if token.kind == "end":
                raise self.fault(f"no {closing!r} to the end of the file; add it")
            if token.kind == "sign":
                depth += (token.text in CLOSING) - (token.text in CLOSING.values())
        self.expect(closing)
        return value

    def made_list(self, name: str) -> list[float]:
        """``LinSpace[first, last, count]``, ``Unique[list]``, ``List[list]``."""
        closing = CLOSING.get(self.take().text, ")")
        if name != "LinSpace":
            values = self.item()
            self.expect(closing)
            return sorted(set(values)) if name == "Unique" else values
        first = self.number()
        self.expect(",")
        last = self.number()
        self.expect(",")
        count = self.whole()
        self.expect(closing)
        if not 2 <= count <= MOST_VERTICES:
            raise self.fault(f"{count} numbers from {first:g} to {last:g}; use 2 to {MOST_VERTICES:,}")
        return self.counted([first + (last - first) * i / (count - 1) for i in range(count)])

    def variable_name(self, name: str | None = None) -> str:
        """A variable's name, the first part of which may be passed: ``name~{1}`` is ``name_1``."""
        name = self.take().text if name is None else name
        while self.taken("~"):
            self.expect("{")
            index = self.number()
            self.expect("}")
            if not abs(index) < 2**53:
                raise self.fault("an index that is no whole number; correct the expression")
            name = f"{name}_{int(index)}"
        return name

    def list_of(self, name: str) -> list[float]:
        """``name[]`` or ``name()``: all of a variable; the brackets may be missing."""
        values = self.known(name)
        if self.next.text in ("(", "["):
            self.expect(CLOSING[self.take().text])
        return values

    def known(self, name: str) -> list[float]:
        """The numbers of a variable.

        Raises:
            DomainError: it is not set; NotReadError: it is no variable, but may be a word that Gmsh knows.
        """
        if name in self.variables:
            return self.variables[name]
        if self.next.text in ("(", "[", "{", "."):
            raise self.not_read(name)
        raise self.fault(f"{name[:40]!r} is no number known here; set it before, or open the file in Gmsh, save a .msh")

    def not_read(self, name: str, line: int | None = None) -> NotReadError:
        """The error for a word whose meaning is not read here."""
        return NotReadError(f"{self.where(line)}: {name[:40]!r} is not understood here")

    def variable(self, name: str) -> Value:
        """The number of a variable, all of it (``name[]``) or some of it (``name[2]``, ``name[{0, 2}]``)."""
        values = self.known(name)
        if self.next.text not in ("(", "[") or self.next.kind != "sign":
            if not values:
                raise self.fault(f"{name[:40]!r} is an empty list; give it a number")
            return values[0]
        closing = CLOSING[self.take().text]
        if self.taken(closing):
            return list(self.counted(values))
        if self.next.text == "{":
            chosen = [self.within(index, values, name) for index in self.tags()]
            self.expect(closing)
            return chosen
        found = self.within(self.whole(), values, name)
        self.expect(closing)
        return found

    def within(self, index: int, values: list[float], name: str) -> float:
        """The value at an index, from 0."""
        if not 0 <= index < len(values):
            raise self.fault(f"{name[:40]}[{index}] of a list of {len(values)}; correct the index")
        return values[index]

    def worked_out(self, function: Callable[..., float], arguments: list[float]) -> float:
        """A function's value."""
        try:
            return float(function(*arguments))
        except (ValueError, OverflowError, TypeError, ZeroDivisionError) as error:
            raise self.fault(f"cannot be worked out ({error}); correct the expression") from None

    def is_text(self) -> bool:
        """Whether a text comes next."""
        named = self.next.kind == "name" and (self.next.text in TEXT_FUNCTIONS or self.next.text in self.texts)
        return named or self.next.kind == "text"

    def text(self) -> str:
        """A text: one in quotes, a variable's, or what ``StrCat``, ``Str`` and ``Sprintf`` make of others."""
        if not self.is_text():
            raise self.fault(f"{self.next.text[:40]!r} where a text is needed; correct the statement")
        token = self.take()
        if token.kind == "text":
            return self.bounded(token.text[1:-1])
        if token.text in self.texts:
            return self.texts[token.text]
        self.deeper("more than {} texts in each other; simplify the expression")
        closing = CLOSING.get(self.take().text, ")")
        parts, numbers = [self.text()], []
        while self.taken(","):
            if token.text == "Sprintf":
                numbers.append(self.number())
            else:
                parts.append(self.text())
        self.expect(closing)
        self.depth -= 1
        if token.text == "Sprintf":
            return self.bounded(self.formatted(parts[0], numbers))
        return self.bounded(("\n" if token.text == "Str" else "").join(parts))

    def formatted(self, text: str, numbers: list[float]) -> str:
        """A text with numbers in the places of its ``%g``."""
        left = iter(numbers)

        def written(match: re.Match[str]) -> str:
            if match[0] == "%%":
                return "%"
            number = next(left, math.nan)
            if match[1] in "diu":
                return match[0].replace("l", "") % (int(number) if math.isfinite(number) else 0)
            return match[0].replace("l", "") % number

        return FORMAT.sub(written, text)

    def bounded(self, text: str) -> str:
        """The text, if it is not too long."""
        if len(text) > MOST_LETTERS:
            raise self.fault(f"a text of {len(text)} letters, at most {MOST_LETTERS} are possible; shorten it")
        return text
