"""Plane and shell elements out of Abaqus decks (``.inp``), of all the types that meshers write.

meshio knows few of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from envs.types import Floats, Ints

#: Families of elements that lie in a surface: continuum, axisymmetric, heat, acoustic, membrane, rigid, shell.
SURFACE = re.compile(r"(CPEG?|CPS|C?G?AX[A-Z]*|DC2D|DCAX|AC2D|ACAX|M3D|SFM3D|R3D|DS|SC?|STRI)\d", re.IGNORECASE)

#: Nodes of an element -> its corners.
CORNERS = {3: 3, 6: 3, 4: 4, 8: 4, 9: 4}


def read_abaqus(path: Path) -> tuple[Floats, Ints, Ints]:
    """Nodes (n, 3), quadrilaterals (m, 4) and triangles (t, 3) of a deck; nodes at edge middles are left out.

    Raises:
        ValueError: a line that is not what its keyword says, or an element of a node that is not there.
    """
    nodes: dict[int, tuple[float, ...]] = {}
    elements: dict[int, list[list[int]]] = {3: [], 4: []}
    for keyword, kind, line, fields in data_lines(path):
        try:
            if keyword == "*NODE":
                x, y, z = [*map(float, fields[1:4]), 0.0, 0.0][:3]
                nodes[int(fields[0])] = (x, y, z)
            elif keyword == "*ELEMENT" and SURFACE.match(kind) and (corners := CORNERS.get(len(fields) - 1)):
                elements[corners].append([int(field) for field in fields[1 : corners + 1]])
        except ValueError:
            raise ValueError(f"line {line}: {', '.join(fields)[:40]} is no {keyword[1:].lower()}") from None
    number = {node: i for i, node in enumerate(nodes)}
    try:
        quads, triangles = (
            np.array([[number[node] for node in element] for element in elements[k]], dtype=np.int64).reshape(-1, k)
            for k in (4, 3)
        )
    except KeyError as error:
        raise ValueError(f"an element of node {error}, which is not there") from None
    return np.array(list(nodes.values())).reshape(-1, 3), quads, triangles


def data_lines(path: Path) -> Iterator[tuple[str, str, int, list[str]]]:
    """Each data line's keyword, element type, number and fields; one that ends in a comma goes on in the next."""
    keyword = kind = ""
    fields: list[str] = []
    for line, text in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        if text.startswith("**") or not text.strip():
            continue
        if text.startswith("*"):
            keyword, *options = [part.strip().upper() for part in text.split(",")]
            kind = next((option.partition("=")[2].strip() for option in options if option.startswith("TYPE")), "")
            continue
        fields += [field.strip() for field in text.split(",") if field.strip()]
        if not text.rstrip().endswith(","):
            yield keyword, kind, line, fields
            fields = []
