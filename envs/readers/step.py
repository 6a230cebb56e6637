"""STEP: the plane faces of a file, with their circles, ellipses and splines kept exact. Gmsh reads it, an extra.

Gmsh's OpenCASCADE reads the file in a process that may open no other and has little memory and time (`gmsh_program`).
The faces must lie in one plane; where that is not the x, y plane, they are read in coordinates of their own.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from envs.polygons import curves
from envs.polygons.drawing import Drawing, Line, Reading
from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve
from envs.polygons.rings import check_coordinates, check_count, extent
from envs.readers.closed_loops import faces
from envs.readers.file_check import bytes_of
from envs.readers.geo_gmsh import answer_of, exact_of, installed
from envs.readers.nesting import Rings, nested
from envs.readers.piece_network import lies_on, network_of
from envs.readers.pieces import Piece
from envs.types import DomainError, Floats

#: Ends closer than this share of the extent meet, and a plane is one within as much of it.
ENDS_MEET = 1e-6

#: Of a label that a program gave by itself.
NO_NAME = ("Open CASCADE", "OpenCASCADE", "Unnamed", "NONE")

#: Axes of the plane that the faces lie in, of which each is read as x and y, by the axis across.
AXES = ((1, 2), (0, 2), (0, 1))


def drawing_of_file(path: Path, reading: Reading) -> Drawing:
    """What a STEP file states.

    Raises:
        DomainError: Gmsh is not there or cannot read the file, a solid, or faces that do not lie in one plane.
    """
    source = str(path)
    if not installed():
        raise DomainError(f"{source}: STEP is read by Gmsh; pip install gmsh")
    content = bytes_of(path)
    if not content.lstrip().startswith(b"ISO-10303-21"):
        raise DomainError(f"{source}: not a STEP file, it does not begin with ISO-10303-21; save it as STEP")
    found = answer_of(content, source, "part.step")
    if found["volumes"]:
        raise DomainError(f"{source}: a solid; save the one face of it that is to be meshed")
    if not found["surfaces"]:
        raise DomainError(f"{source}: no face in it; save a plane face")
    for tag, kind in found["kinds"].items():
        if kind != "Plane":
            raise DomainError(f"{source}: face {tag} is no plane; save plane faces alone")
    plane, note = plane_of(found, source)
    pieces, keys = pieces_of(found, plane)
    size = extent(np.concatenate([piece.rough for piece in pieces]))
    sides = flattened(pieces, size, reading.edge_length, source)
    polygons, regions = list[Rings](), list[str]()
    for tag, edges in found["surfaces"].items():
        chosen = list(dict.fromkeys(keys[abs(edge)] for edge in edges))
        network = network_of([pieces[k] for k in chosen], ENDS_MEET * size, source)
        group = faces([sides[k] for k in chosen], network.ends, source)
        face = nested(group, source)
        if len(face) != 1:
            raise DomainError(f"{source}: the edges of face {tag} bound {len(face)} regions; save it again")
        polygons.append(face[0])
        regions.append(name_of(found["names"].get(tag, "")))
    lines = [
        Line(side, curve=piece.curve) for side, piece in zip(sides, pieces, strict=True) if piece.curve is not None
    ]
    notes = [note, "lengths are millimetres, as they are read from STEP"]
    return Drawing(polygons, tuple(regions) if any(regions) else (), lines, notes=[note for note in notes if note])


def plane_of(found: dict[str, Any], source: str) -> tuple[Floats, str]:
    """(2, 3) the axes of the plane that all lies in, and what the user is told of it.

    Raises:
        DomainError: there is no such plane.
    """
    places = [np.array(list(found["points"].values())).reshape(-1, 3)]
    places += [np.array(curve["places"]).reshape(-1, 3) for curve in found["curves"].values() if "places" in curve]
    points = np.concatenate(places)
    check_coordinates(points, source)
    off = points - points.mean(axis=0)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    for across in (2, 1, 0):
        if np.ptp(points[:, across]) <= ENDS_MEET * size:
            axes = np.eye(3)[list(AXES[across])]
            told = [f"{'xyz'[axis]}" for axis in AXES[across]]
            return axes, "" if across == 2 else f"faces in the {', '.join(told)} plane are read as x, y"
    normal = np.linalg.svd(off, full_matrices=False)[2][-1]
    if np.ptp(points @ normal) > ENDS_MEET * size:
        raise DomainError(f"{source}: faces in several planes; save those of one alone")
    along = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
    along /= np.linalg.norm(along)
    return np.stack([along, np.cross(normal, along)]), "faces in a slanted plane are read in coordinates within it"


def pieces_of(found: dict[str, Any], plane: Floats) -> tuple[list[Piece], dict[int, int]]:
    """The curves that bound faces, in the plane, and the number of each by its tag."""
    places = {int(tag): plane @ np.array(place) for tag, place in found["points"].items()}
    used = {abs(edge) for edges in found["surfaces"].values() for edge in edges}
    pieces, keys = list[Piece](), dict[int, int]()
    for text, curve in found["curves"].items():
        if int(text) not in used:
            continue
        ends = [places[int(end)] for end in curve["ends"]]
        keys[int(text)] = len(pieces)
        if "at" not in curve:
            pieces.append(Piece(np.array(ends)))
            continue
        samples = np.array(curve["places"]).reshape(-1, 3) @ plane.T
        slopes = np.array(curve["slopes"]).reshape(-1, 3) @ plane.T
        flat = np.column_stack([slopes, np.zeros(len(slopes))]).ravel().tolist()
        exact = exact_of(curve["kind"], curve["at"], samples, flat)
        assert isinstance(exact, CircleArc | EllipseArc | ParametricCurve)
        span = exact.breaks[[0, -1]].tolist() if isinstance(exact, ParametricCurve) else [
            exact.start, exact.start + exact.sweep
        ]  # fmt: skip
        tips = np.array(ends) if len(ends) == 2 else np.zeros((0, 2))
        pieces.append(Piece(tips, exact, (float(span[0]), float(span[1]))))
    return pieces, keys


def flattened(pieces: list[Piece], size: float, edge_length: float | None, source: str) -> list[Floats]:
    """The vertices of each piece; of two pieces upon each other those of one, so that faces share their side."""
    fineness = curves.flattening(size, edge_length)
    network = network_of(pieces, ENDS_MEET * size, source)
    known: dict[tuple[int, int], list[int]] = defaultdict(list)
    sides, total = list[Floats](), 0
    for i, (a, b) in enumerate(network.ends.tolist()):
        same = known[min(a, b), max(a, b)]
        twin = next((j for j in same if lies_on(pieces[i], pieces[j], 2.0 * network.tolerance)), None)
        if twin is None:
            points = pieces[i].flattened(fineness).copy()
            points[0], points[-1] = network.places[[a, b]]
            same.append(i)
        else:
            points = sides[twin] if network.ends[twin, 0] == a else sides[twin][::-1]
        total += len(points)
        check_count(total, source)
        sides.append(points)
    return sides


def name_of(label: str) -> str:
    """The name in a label of Gmsh's, the last part; empty where a program gave it by itself."""
    name = label.rpartition("/")[2].strip()
    return "" if any(word in name for word in NO_NAME) or name.replace(".", "").isdigit() else name
