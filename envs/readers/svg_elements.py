"""The elements of an SVG drawing: a tree read without DTDs and entities, and the shapes that are seen in it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

import numpy as np

from envs.readers.file_check import excerpt
from envs.readers.svg_path import Transform
from envs.types import DomainError, Floats

#: Elements of a drawing at most, those that are used counted each time, and elements in each other.
MOST_ELEMENTS, DEPTH = 200_000, 100

SHAPES = ("path", "rect", "circle", "ellipse", "line", "polyline", "polygon")

#: What holds others that are drawn.
GROUPS = ("svg", "g", "a", "switch")

#: What is drawn and is no outline.
PASSED_OVER = ("text", "image", "foreignObject")

SVG, INKSCAPE, XLINK = "http://www.w3.org/2000/svg", "http://www.inkscape.org/namespaces/inkscape", (
    "http://www.w3.org/1999/xlink"
)  # fmt: skip

#: Names that programs give by themselves.
NO_NAME = re.compile(
    r"(path|rect|circle|ellipse|polygon|polyline|line|g|use|layer|svg|text|shape)?[-_.]?\d+([-_.]\d+)*"
)

FUNCTION = re.compile(r"\s*,?\s*([A-Za-z]+)\s*\(([^()]*)\)")
RULE = re.compile(r"([^{}]*)\{([^{}]*)\}")
COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)

#: Pixels of a unit, by CSS: 96 to the inch.
PIXELS = {"": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "pt": 96 / 72, "pc": 16.0, "q": 96 / 101.6}

LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([A-Za-z%]*)\s*")

#: What is taken of styles.
STYLED = ("fill", "display", "visibility")

IDENTITY = Transform(np.eye(2), np.zeros(2))


@dataclass(eq=False)
class Element:
    """One element.

    Attributes:
        tag: its name; empty: of another language.
        attributes: by name; of other languages as ``language name``.
        line: in the file.
        children: in order.
        text: what is written in it, of a style sheet alone.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    text: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape that is seen.

    Attributes:
        element: it.
        transform: from its coordinates to those of the outermost element.
        name: its own, or that of the nearest group around it that has one.
        filled: whether its inside is painted.
    """

    element: Element
    transform: Transform
    name: str
    filled: bool


def tree_of(content: bytes, source: str) -> Element:
    """The outermost element.

    Raises:
        DomainError: no XML, no SVG, a DTD with declarations of its own, or elements too many or too deep.
    """
    parser = expat.ParserCreate(namespace_separator=" ")
    root = Element("", {}, 0)
    path, count = [root], 0

    def doctype(name: str, system: str | None, public: str | None, internal: int) -> None:
        if internal:
            line = parser.CurrentLineNumber
            raise DomainError(f"{source}: line {line}: a DTD in the file, which is not read; save it as plain SVG")

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > MOST_ELEMENTS or len(path) > DEPTH:
            raise DomainError(
                f"{source}: more than {MOST_ELEMENTS:,} elements, or {DEPTH} in each other; simplify the drawing"
            )
        language, _, tag = name.rpartition(" ")
        element = Element(tag if language in ("", SVG) else "", attributes, parser.CurrentLineNumber)
        path[-1].children.append(element)
        path.append(element)

    def characters(text: str) -> None:
        if path[-1].tag == "style":
            path[-1].text.append(text)

    parser.StartDoctypeDeclHandler = doctype
    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: path.pop() and None
    parser.CharacterDataHandler = characters
    parser.ExternalEntityRefHandler = lambda *_: 0
    try:
        parser.Parse(content, True)
    except DomainError:
        raise
    except (ValueError, LookupError):  # expat asks Python for encodings that it does not know
        raise DomainError(f"{source}: in an encoding that is not read; save it as UTF-8") from None
    except expat.ExpatError as error:
        raise DomainError(
            f"{source}: line {error.lineno}: not valid XML ({excerpt(str(error).partition(':')[0])}); save it again"
        ) from None
    outermost = root.children[0]
    if outermost.tag != "svg":
        raise DomainError(f"{source}: no SVG drawing, the outermost element is another; save it as plain SVG")
    return outermost


class Seen:
    """The shapes that are seen of a drawing.

    Attributes:
        passed_over: how many of each tag were left out.
    """

    def __init__(self, root: Element, source: str) -> None:
        self.source = source
        self.root = root
        self.passed_over: dict[str, int] = {}
        self.by_id: dict[str, Element] = {}
        self.rules: dict[str, dict[str, str]] = {}
        self.taken = 0
        waiting = [root]
        while waiting:
            element = waiting.pop()
            if "id" in element.attributes:
                self.by_id.setdefault(element.attributes["id"], element)
            if element.tag == "style":
                self.rules |= rules_of("".join(element.text))
            waiting += element.children

    def shapes(self) -> Iterator[Shape]:
        """The shapes, in order.

        Raises:
            DomainError: a transform that is none, or elements too many or too deep.
        """
        yield from self.below(self.root, IDENTITY, "", True, 0)

    def below(self, element: Element, transform: Transform, name: str, filled: bool, depth: int) -> Iterator[Shape]:
        """The shapes of an element and of what it holds."""
        self.taken += 1
        if self.taken > MOST_ELEMENTS or depth > DEPTH:
            raise DomainError(
                f"{self.source}: more than {MOST_ELEMENTS:,} elements, or {DEPTH} in each other; simplify the drawing"
            )
        style = self.style_of(element)
        if style.get("display") == "none" or style.get("visibility") in ("hidden", "collapse"):
            return
        where = f"{self.source}: line {element.line}"
        if "transform" in element.attributes:
            transform = transform.after(transform_of(element.attributes["transform"], where))
        name = name_of(element) or name
        filled = style.get("fill", "" if filled else "none") != "none"
        if element.tag in SHAPES:
            yield Shape(element, transform, name, filled)
        elif element.tag == "use":
            used = self.used(element)
            if used is not None:
                moved = Transform(np.eye(2), np.array([length(element, "x", where), length(element, "y", where)]))
                inner = transform.after(moved)
                if used.tag == "symbol":
                    for child in used.children:
                        yield from self.below(child, inner, name, filled, depth + 1)
                else:
                    yield from self.below(used, inner, name, filled, depth + 1)
        elif element.tag in GROUPS:
            if element.tag == "svg" and element is not self.root:
                if "viewBox" in element.attributes:
                    raise DomainError(f"{where}: a drawing in the drawing with a viewBox of its own; ungroup it")
                at = np.array([length(element, "x", where), length(element, "y", where)])
                transform = transform.after(Transform(np.eye(2), at))
            for child in element.children:
                yield from self.below(child, transform, name, filled, depth + 1)
        elif element.tag in PASSED_OVER:
            self.passed_over[element.tag] = self.passed_over.get(element.tag, 0) + 1

    def used(self, element: Element) -> Element | None:
        """What a ``use`` shows again; None when it is not in the file."""
        link = element.attributes.get("href", element.attributes.get(f"{XLINK} href", ""))
        return self.by_id.get(link[1:]) if link.startswith("#") else None

    def style_of(self, element: Element) -> dict[str, str]:
        """What of an element's style counts here: attributes, then style sheets, then its own style."""
        found = {key: element.attributes[key].strip() for key in STYLED if key in element.attributes}
        classes = [f".{name}" for name in element.attributes.get("class", "").split()]
        for selector in (element.tag, *classes, f"#{element.attributes.get('id', '')}"):
            found |= self.rules.get(selector, {})
        return found | declarations(element.attributes.get("style", ""))


def rules_of(sheet: str) -> dict[str, dict[str, str]]:
    """What a style sheet says of tags, classes and ids; other selectors are left out."""
    found: dict[str, dict[str, str]] = {}
    for selectors, body in RULE.findall(COMMENT.sub("", sheet)):
        for selector in selectors.split(","):
            found[selector.strip()] = found.get(selector.strip(), {}) | declarations(body)
    return found


def declarations(text: str) -> dict[str, str]:
    """What a style says of what counts here."""
    pairs = (part.partition(":") for part in text.split(";"))
    return {key.strip(): value.split("!")[0].strip() for key, _, value in pairs if key.strip() in STYLED}


def name_of(element: Element) -> str:
    """The name that an element has: its label, its id unless a program gave it, or its first class."""
    attributes = element.attributes
    label = attributes.get(f"{INKSCAPE} label", "").strip()
    if label:
        return label
    identity = attributes.get("id", "").strip()
    if identity and not NO_NAME.fullmatch(identity):
        return identity
    classes = [name for name in attributes.get("class", "").split() if not re.fullmatch(r"(st|cls-?)\d+", name)]
    return classes[0] if classes and element.tag != "svg" else ""


def transform_of(text: str, where: str) -> Transform:
    """The map that a transform attribute states.

    Raises:
        DomainError: it states none.
    """
    found, at = IDENTITY, 0
    text = text.strip()
    while at < len(text):
        match = FUNCTION.match(text, at)
        if match is None:
            raise not_understood(text[at:], where)
        try:
            numbers = [float(number) for number in match[2].replace(",", " ").split()]
            found = found.after(of_function(match[1], *numbers))
        except (TypeError, ValueError, KeyError):
            raise not_understood(match[0], where) from None
        at = match.end()
    return found


def of_function(name: str, *n: float) -> Transform:
    """The map of one function of a transform attribute."""
    return FUNCTIONS[name](*n)


def not_understood(text: str, where: str) -> DomainError:
    """What to raise for a transform that is none."""
    return DomainError(f"{where}: the transform {excerpt(text, 40)!r} is not understood; correct it")


def rotation(angle: float, x: float = 0.0, y: float = 0.0) -> Transform:
    """A turn by degrees about a place."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    matrix, about = np.array([[c, -s], [s, c]]), np.array([x, y])
    return Transform(matrix, about - matrix @ about)


def linear(*rows: list[float]) -> Transform:
    """A map that leaves the origin where it is."""
    return Transform(np.array(rows), np.zeros(2))


FUNCTIONS: dict[str, Any] = {
    "matrix": lambda a, b, c, d, e, f: Transform(np.array([[a, c], [b, d]]), np.array([e, f])),
    "translate": lambda x, y=0.0: Transform(np.eye(2), np.array([x, y])),
    "scale": lambda x, y=None: linear([x, 0.0], [0.0, x if y is None else y]),
    "rotate": rotation,
    "skewX": lambda angle: linear([1.0, np.tan(np.radians(angle))], [0.0, 1.0]),
    "skewY": lambda angle: linear([1.0, 0.0], [np.tan(np.radians(angle)), 1.0]),
}


def length(element: Element, name: str, where: str, default: float = 0.0) -> float:
    """An attribute's length in pixels.

    Raises:
        DomainError: it is none.
    """
    given = element.attributes.get(name)
    if given is None or given.strip() == "auto":
        return default
    number, unit = length_in(given, name, where)
    return number * PIXELS[unit]


def length_in(given: str, name: str, where: str) -> tuple[float, str]:
    """A length's number and unit.

    Raises:
        DomainError: it is none.
    """
    match = LENGTH.fullmatch(given)
    if match is None or match[2].lower() not in PIXELS:
        raise DomainError(
            f"{where}: {name} {excerpt(given, 30)!r} is no length in px, mm, cm, in, pt or pc; correct it"
        )
    return float(match[1]), match[2].lower()


def points_in(text: str, where: str) -> Floats:
    """(k, 2) the places of a ``points`` attribute.

    Raises:
        DomainError: it is no list of pairs.
    """
    try:
        numbers = np.array([float(number) for number in text.replace(",", " ").split()])
    except ValueError:
        raise DomainError(f"{where}: points {excerpt(text, 40)!r} are no list of numbers; correct them") from None
    if len(numbers) % 2:
        raise DomainError(f"{where}: points with a number too many; correct them")
    return numbers.reshape(-1, 2)
