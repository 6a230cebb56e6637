"""What a Gmsh script defines, points, curves, loops, surfaces and physical groups, by tags; and what moves them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from envs.polygons.rings import MOST_VERTICES
from envs.types import Curve as ExactCurve
from envs.types import Floats

Defined = TypeVar("Defined")

#: A dimension and a tag.
Shape = tuple[int, int]

#: Dimensions of what has tags.
POINT, CURVE, SURFACE, VOLUME = 0, 1, 2, 3

#: Points closer than this share of the extent are one where a script says so, as Gmsh has it.
COHERENT = 1e-8

#: Points looked at by copies, transformations and deletions at most, over a whole script.
MOST_LOOKED_AT = 10_000_000

#: Sizes at a point from which on it is none: Gmsh's own default is 1e22.
MOST_SIZE = 1e21


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve as the script states it.

    Attributes:
        name: its kind.
        points: its points' tags.
        line: its line in the file.
        exact: the curve itself, where its points do not tell it.
    """

    name: str
    points: tuple[int, ...]
    line: int
    exact: ExactCurve | None = None


class Table(dict[int, Defined]):
    """What is defined, by tag.

    Attributes:
        highest: the highest tag that was used so far.
    """

    highest = 0

    def __setitem__(self, tag: int, defined: Defined) -> None:
        super().__setitem__(tag, defined)
        self.highest = max(self.highest, tag)


@dataclass(eq=False)
class Group:
    """A physical group.

    Attributes:
        dimension: of what is in it.
        tag: its number.
        name: empty: it has none.
        members: the tags of what is in it, perhaps signed.
    """

    dimension: int
    tag: int
    name: str = ""
    members: list[int] = field(default_factory=list)


@dataclass(eq=False)
class Model:
    """What a script defines, by tag.

    Attributes:
        points: (x, y, z).
        sizes: edge lengths at points, where the script states any.
        curves: the curves.
        loops: signed curve tags, negative against the curve's direction.
        surfaces: the signed curve tags of each, in any order.
        shells: surface loops and volumes, of which only the tags matter.
        counts: segments, law and ratio of transfinite curves.
        groups: physical groups by dimension and number, in the order of the script.
        numbers: of the groups that have a name, by dimension and name.
        highest_group: the highest number of a group.
        embedded_points, embedded_curves: tags of what lies in surfaces without bounding them.
        notes: what was read in another way than it was stated, a line each.
        replaceable: the line of the first statement that only Gmsh itself reads as it means it, if any.
        old_numbers: whether ``newc`` and the like count all kinds together, as they do unless a script says otherwise.
        auto_coherence: whether what was moved becomes one with what it lies on.
        looked_at: points looked at by copies, transformations and deletions so far.
    """

    points: Table[tuple[float, float, float]] = field(default_factory=Table)
    sizes: dict[int, float] = field(default_factory=dict)
    curves: Table[Curve] = field(default_factory=Table)
    loops: Table[list[int]] = field(default_factory=Table)
    surfaces: Table[list[int]] = field(default_factory=Table)
    shells: Table[None] = field(default_factory=Table)
    counts: dict[int, tuple[int, str, float]] = field(default_factory=dict)
    groups: dict[Shape, Group] = field(default_factory=dict)
    numbers: dict[tuple[int, str], int] = field(default_factory=dict)
    highest_group: int = 0
    embedded_points: list[int] = field(default_factory=list)
    embedded_curves: list[int] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    replaceable: str = ""
    old_numbers: bool = True
    auto_coherence: bool = True
    looked_at: int = 0

    def of(self, dimension: int) -> Table[tuple[float, float, float]] | Table[Curve] | Table[list[int]] | Table[None]:
        """What has a dimension."""
        return (self.points, self.curves, self.surfaces, self.shells)[dimension]

    def look_at(self, points: int) -> None:
        """Count points that are looked at.

        Raises:
            ValueError: they are too many.
        """
        self.looked_at += points
        if self.looked_at > MOST_LOOKED_AT or len(self.points) > MOST_VERTICES:
            raise ValueError("too many copies, transformations or deletions of too many points")

    def new_region(self) -> int:
        """A number that no curve, loop, surface or group has."""
        tables = (self.curves, self.loops, self.surfaces, self.shells)
        return max(*(table.highest for table in tables), self.highest_group) + 1

    def new(self, table: Table[Defined]) -> int:
        """A new tag for a table: above all of points, and of everything else together."""
        counted_alone = table is self.points or not self.old_numbers
        return table.highest + 1 if counted_alone else self.new_region()

    def group(self, dimension: int, name: str, tag: int | None) -> Group:
        """The physical group of a name or a number, made when there is none."""
        if tag is None:
            tag = self.numbers.get((dimension, name), self.highest_group + 1)
        if name:
            self.numbers[dimension, name] = tag
        self.highest_group = max(self.highest_group, tag)
        found = self.groups.setdefault((dimension, tag), Group(dimension, tag))
        found.name = found.name or name
        return found

    def state_size(self, tags: Iterable[int], size: float) -> None:
        """Note the size at points; as in Gmsh 0, or a huge one, is none."""
        for tag in tags:
            self.sizes.pop(tag, None)
            if 0.0 < size < MOST_SIZE:
                self.sizes[tag] = size

    def boundary(self, shapes: Sequence[Shape], combined: bool = False) -> list[Shape]:
        """Dimension and tag of what bounds shapes; combined: without what bounds two of them."""
        found: list[Shape] = []
        for dimension, tag in shapes:
            if dimension == SURFACE:
                found += [(CURVE, abs(curve)) for curve in self.surfaces[tag]]
            elif dimension == CURVE:
                points = self.curves[tag].points
                found += [(POINT, points[0]), (POINT, points[-1])]
        if not combined:
            return found
        times: dict[Shape, int] = {}
        for shape in found:
            times[shape] = times.get(shape, 0) + 1
        return [shape for shape, n in times.items() if n % 2]

    def points_of(self, shapes: Sequence[Shape]) -> list[int]:
        """Tags of all points that define shapes, each once."""
        found: dict[int, None] = {}
        for dimension, tag in shapes:
            curves = {SURFACE: [abs(c) for c in self.surfaces[tag]] if dimension == SURFACE else [], CURVE: [tag]}
            if dimension == POINT:
                found[tag] = None
            for curve in curves.get(dimension, []):
                found |= dict.fromkeys(self.curves[curve].points)
        return list(found)

    def move(self, shapes: Sequence[Shape], moved: Callable[[Floats], Floats]) -> None:
        """Move the points of shapes, by a function of (n, 3) places; what then lies on others is one with them."""
        tags = self.points_of(shapes)
        if tags:
            places = moved(np.array([self.points[tag] for tag in tags], dtype=np.float64))
            for tag, place in zip(tags, places.tolist(), strict=True):
                self.points[tag] = (place[0], place[1], place[2])
        if self.auto_coherence:
            self.make_coherent()

    def copies(self, shapes: Sequence[Shape]) -> list[Shape]:
        """Copies of shapes, with tags as Gmsh gives them."""
        return [(dimension, self.copy_of(dimension, tag)) for dimension, tag in shapes]

    def copy_of(self, dimension: int, tag: int) -> int:
        """The tag of a copy: of curves with points of their own, of surfaces with curves of their own."""
        if dimension == POINT:
            self.look_at(1)
            copy = self.new(self.points)
            self.points[copy] = self.points[tag]
            self.state_size([copy], self.sizes.get(tag, np.inf))
            return copy
        if dimension == CURVE:
            curve = self.curves[abs(tag)]
            copy = self.new(self.curves)
            given = curve.points if tag > 0 else curve.points[::-1]
            points = tuple(self.copy_of(POINT, point) for point in given)
            for end in (given[0], given[-1]):  # Gmsh copies the ends once more; they are made one again later
                self.copy_of(POINT, end)
            # An ellipse's points have an order: start, centre, a point of the axis, end.
            swapped = curve.name == "Ellipse" and len(points) == 4 and tag < 0
            points = (points[0], points[2], points[1], points[3]) if swapped else points
            self.curves[copy] = Curve(curve.name, points, curve.line)
            return copy
        copy = self.new(self.surfaces)
        self.surfaces[copy] = []
        self.surfaces[copy] = [self.copy_of(CURVE, curve) for curve in self.surfaces[tag]]
        return copy

    def make_coherent(self) -> None:
        """Make points at one place one, then curves through the same points; the lowest tag stays.

        Raises:
            ValueError: it would look at too many points.
        """
        self.look_at(len(self.points))
        tags = sorted(self.points)
        places = np.array([self.points[tag] for tag in tags]).reshape(-1, 3)
        size = float(np.linalg.norm(np.ptp(places, axis=0))) if len(places) else 0.0
        if not np.isfinite(size) or size == 0.0:
            return
        _, first, number = np.unique(
            np.round(places / (COHERENT * size)), axis=0, return_index=True, return_inverse=True
        )
        if len(first) == len(tags):
            return
        stays = {tag: tags[first[i]] for tag, i in zip(tags, number.ravel().tolist(), strict=True)}
        for tag, kept in stays.items():
            if tag != kept:
                del self.points[tag]
                self.sizes.pop(tag, None)
        self.points.highest = max(self.points)
        self.embedded_points = [stays.get(tag, tag) for tag in self.embedded_points]
        for tag, curve in self.curves.items():
            points = tuple(stays.get(point, point) for point in curve.points)
            if points != curve.points:
                dict.__setitem__(self.curves, tag, Curve(curve.name, points, curve.line, curve.exact))
        self.replace_in_groups(POINT, stays)
        self.join_curves()

    def join_curves(self) -> None:
        """Make curves of one kind through the same points one, in either direction."""
        kept: dict[tuple[str, tuple[int, ...]], int] = {}
        stays: dict[int, int] = {}
        for tag in sorted(self.curves):
            curve = self.curves[tag]
            backwards = kept.get((curve.name, curve.points[::-1]))
            same = kept.setdefault((curve.name, curve.points), tag)
            stays[tag] = same if same != tag else -backwards if backwards is not None else tag
        gone = [tag for tag, same in stays.items() if same != tag]
        if not gone:
            return
        for tag in gone:
            del self.curves[tag]
        self.curves.highest = max(self.curves)

        def signed(tag: int) -> int:
            return stays.get(tag, tag) if tag > 0 else -stays.get(-tag, -tag)

        for table in (self.loops, self.surfaces):
            for tag, members in table.items():
                dict.__setitem__(table, tag, [signed(member) for member in members])
        self.embedded_curves = [abs(signed(tag)) for tag in self.embedded_curves]
        self.replace_in_groups(CURVE, {tag: abs(same) for tag, same in stays.items()})

    def replace_in_groups(self, dimension: int, stays: dict[int, int]) -> None:
        """Put what stays in the place of what it stands for."""
        for group in self.groups.values():
            if group.dimension == dimension:
                group.members = [stays.get(abs(tag), abs(tag)) for tag in group.members]

    def delete(self, shapes: Sequence[Shape], recursive: bool = False) -> None:
        """Take shapes out, but for what bounds others; recursive: with what bounds them, too."""
        waiting = dict.fromkeys(shapes)
        for dimension in (SURFACE, CURVE, POINT):
            chosen = [tag for d, tag in waiting if d == dimension and tag in self.of(d)]
            if not chosen:
                continue
            self.look_at(len(self.points))
            used = self.bounding(dimension)
            for tag in chosen:
                if tag in used:
                    continue
                if recursive:
                    waiting |= dict.fromkeys(self.boundary([(dimension, tag)]))
                del self.of(dimension)[tag]

    def bounding(self, dimension: int) -> set[int]:
        """Tags of the curves that bound surfaces, or of the points of curves."""
        if dimension == CURVE:
            return {abs(curve) for surface in self.surfaces.values() for curve in surface}
        return {point for curve in self.curves.values() for point in curve.points} if dimension == POINT else set()
