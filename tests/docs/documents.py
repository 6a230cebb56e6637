"""What the documents of the checkout hold: fenced blocks, commands, links, headings, inline code."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from checkout import ROOT, files

FENCE = re.compile(r" *```(\w*)")
#: A comment of a command: two blanks or more, then a number sign.
COMMENT = re.compile(r"\s{2,}#.*$")


@dataclass(frozen=True)
class Code:
    """A piece of code in a document: a fenced block, a command of one, or inline code.

    Attributes:
        document: from the root, as ``docs/serving.md``.
        line: where it begins, from 1.
        language: after the fence; empty for inline code.
        text: without fences, indentation of the fence and, for commands, comments.
    """

    document: str
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.document}:{self.line}"


def documents() -> list[str]:
    """All Markdown files."""
    return [name for name in files() if name.endswith(".md")]


@cache
def _parts(document: str) -> tuple[tuple[Code, ...], tuple[tuple[int, str], ...]]:
    """The fenced blocks, and the numbered lines outside of them."""
    blocks, prose, held, opened = [], [], [], None
    for number, line in enumerate((ROOT / document).read_text(encoding="utf-8").splitlines(), 1):
        fence = FENCE.fullmatch(line)
        if fence is None:
            (prose if opened is None else held).append((number, line))
        elif opened is None:
            held, opened = [], (number, fence[1], len(line) - len(line.lstrip()))
        else:
            assert not fence[1], f"{document}:{number}: a block begins within that of line {opened[0]}"
            text = "\n".join(line[opened[2] :] for _, line in held)
            blocks.append(Code(document, opened[0] + 1, opened[1], text))
            opened = None
    assert opened is None, f"{document}: the block of line {opened} is not closed"
    return tuple(blocks), tuple(prose)


def blocks(document: str) -> tuple[Code, ...]:
    """The fenced blocks."""
    return _parts(document)[0]


def prose(document: str) -> str:
    """The text outside of fenced blocks."""
    return "\n".join(line for _, line in _parts(document)[1])


def commands(document: str) -> list[Code]:
    """The command lines of the blocks of shell."""
    found = []
    for block in blocks(document):
        if block.language == "sh":
            for i, line in enumerate(block.text.splitlines()):
                if text := COMMENT.sub("", line).strip():
                    found.append(Code(document, block.line + i, "sh", text))
    return found


def inline(document: str) -> list[Code]:
    """The inline code."""
    return [
        Code(document, number, "", text)
        for number, line in _parts(document)[1]
        for text in re.findall(r"`([^`]+)`", line)
    ]


def links(document: str) -> list[str]:
    """The targets of links and pictures, those to other sites left out."""
    text = re.sub(r"`[^`\n]*`", "", prose(document))
    targets = re.findall(r"\]\(\s*<?([^)\s>]+)", text) + re.findall(r"^\[[^\]]+\]:\s*(\S+)", text, re.M)
    targets += re.findall(r"<(?:img|a)\b[^>]*?\b(?:src|href)=\"([^\"]+)\"", text)
    return [target for target in targets if not re.match(r"[a-z]+:", target)]


def anchors(document: str) -> set[str]:
    """The anchors of the headings, as GitHub makes them, and those that are given."""
    found: dict[str, int] = {}
    for title in re.findall(r"^#{1,6} +(.+?) *#*$", prose(document), re.M):
        title = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", title)
        slug = re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
        found[slug] = found.get(slug, -1) + 1
    given = set(re.findall(r'<a id="([\w-]+)"></a>', prose(document)))
    return given | {slug if i == 0 else f"{slug}-{i}" for slug, count in found.items() for i in range(count + 1)}


def leads_to(document: str, target: str) -> str | None:
    """The file or folder that a link leads to, from the root; None if it is not there, or lacks the anchor."""
    path, _, anchor = target.partition("#")
    place = (ROOT / document).parent / path if path else ROOT / document
    if not place.exists():
        return None
    name = str(place.resolve().relative_to(ROOT.resolve()))
    if anchor and not (name.endswith(".md") and anchor in anchors(name)):
        return None
    held = name == "." or name in files() or any(file.startswith(f"{name}/") for file in files())
    return name if held else None
