"""Markdown: text of others as it may stand in it, and code."""

from __future__ import annotations

import re

from envs.printable import printable

#: What would begin markup: code, tags and entities, links, emphasis, another cell.
MARKUP = re.compile(r"[\\`|]|\*(?=\S)|(?<!\w)_(?=\S)|(?<=\])[(\[:]")
#: What would end a cell, also within code.
BAR = re.compile(r"(?<!\\)\|")
#: What is no markup as an entity alone.
ENTITIES = {"<": "&lt;", "&": "&amp;"}


class Markdown(str):
    """Text that is Markdown already."""


def escaped(text: str) -> Markdown:
    """Text of any origin, in one line, so that it stands there as it is; Markdown stays what it is."""
    if isinstance(text, Markdown):
        return text
    marked = MARKUP.sub(lambda found: f"\\{found[0]}", " ".join(printable(line) for line in text.split("\n")))
    return Markdown(re.sub(r"<|&(?=#?\w+;)", lambda found: ENTITIES[found[0]], marked))


def in_cell(text: str) -> str:
    """Text of any origin, or Markdown, as a cell of a table."""
    return BAR.sub(r"\|", escaped(text))


def bold(text: str) -> Markdown:
    """Text in bold."""
    return Markdown(f"**{escaped(text)}**")


def code(text: str) -> Markdown:
    """Text as code, in a line."""
    fence = _fence(text, 1)
    gap = " " if text.startswith("`") or text.endswith("`") else ""
    return Markdown(f"{fence}{gap}{printable(text)}{gap}{fence}")


def block(text: str) -> Markdown:
    """Lines as code, in a block."""
    fence = _fence(text, 3)
    lines = "\n".join(printable(line) for line in text.split("\n"))
    return Markdown(f"{fence}\n{lines}\n{fence}")


def _fence(text: str, least: int) -> str:
    """More backticks than stand next to each other in a text."""
    return "`" * max(least, 1 + max(map(len, re.findall("`+", text)), default=0))
