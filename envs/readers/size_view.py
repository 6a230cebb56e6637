"""Sizes in a view of Gmsh, a ``.pos`` file: scalars on points, lines, triangles and quadrangles."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from envs.polygons.size_cells import Size
from envs.readers.file_check import excerpt, text_of
from envs.readers.size_triangles import Triangles, check_values
from envs.types import DomainError, Floats

COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
ELEMENT = re.compile(r"([A-Z][A-Z0-9]+)\s*\(([^(){};]*)\)\s*\{([^(){}]*)\}\s*;?")
AROUND = re.compile(r'\s+|View\s*"[^"\n]*"\s*\{|TIME\s*\{[^{}]*\}\s*;|\}\s*;?')

#: Nodes of the elements that are read.
NODES = {"SP": 1, "SL": 2, "ST": 3, "SQ": 4}


def sizes_of_file(path: Path) -> Size | Floats:
    """What a view says: linear on its triangles and quadrangles, or where it has none (m, 3) rows x, y and a size.

    Raises:
        DomainError: no view as text, or elements that are not read.
        UserError: a size that is not positive.
    """
    source = str(path)
    text = COMMENT.sub(lambda match: "\n" * match.group().count("\n"), text_of(path))
    at, blocks = 0, list[Floats]()
    for match in ELEMENT.finditer(text):
        between(text, at, match.start(), source)
        at = match.end()
        where = f"{source}: line {text.count(chr(10), 0, match.start(1)) + 1}" if len(blocks) < 1000 else source
        blocks.append(element(match, where))
    between(text, at, len(text), source)
    if not blocks:
        raise DomainError(f"{source}: no sizes in it; give a view with SP, ST or SQ elements")
    rows = np.concatenate(blocks)
    starts = np.cumsum([0, *(len(block) for block in blocks)])[:-1]
    counts = np.array([len(block) for block in blocks])
    three, four = starts[counts == 3], starts[counts == 4]
    corners = [three[:, None] + [0, 1, 2], four[:, None] + [0, 1, 2], four[:, None] + [0, 2, 3]]
    if len(three) or len(four):
        return Triangles(rows[:, :2], np.concatenate(corners), rows[:, 2], source)
    check_values(rows[:, :2], rows[:, 2], source)
    return rows


def between(text: str, start: int, end: int, source: str) -> None:
    """Refuse what is neither an element nor what stands around them."""
    while start < end:
        match = AROUND.match(text, start, end)
        if match is None:
            line = text.count("\n", 0, start) + 1
            raise DomainError(
                f"{source}: line {line}: {excerpt(text[start:end].strip().partition(chr(10))[0])!r} is not understood; "
                "save the view again, as parsed .pos"
            )
        start = match.end()


def element(match: re.Match[str], where: str) -> Floats:
    """(n, 3) x, y and the size of each node; of several steps in time the first."""
    kind, places, values = match.groups()
    if kind not in NODES:
        raise DomainError(f"{where}: {excerpt(kind)} elements are no sizes here; give {', '.join(NODES)}")
    try:
        xyz = np.array([float(number) for number in places.split(",")])
        sizes = np.array([float(number) for number in values.split(",")])
    except ValueError:
        raise DomainError(f"{where}: {excerpt(match.group())!r} has something else than numbers; correct it") from None
    nodes = NODES[kind]
    if len(xyz) != 3 * nodes or len(sizes) < nodes:
        raise DomainError(f"{where}: {kind} has {nodes} nodes, x, y, z each, and as many sizes; correct it")
    return np.column_stack([xyz.reshape(-1, 3)[:, :2], sizes[:nodes]])
