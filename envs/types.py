"""Frozen parameter and state types shared by the meshing world.

Everything here is plain data: shapes, units and ranges stand beside each field.
Symbols are those of Pan, Huang, Cheng, Zeng (2023), Neural Networks 157.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from envs.errors import UserError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Points closer than this share of the domain's diameter count as touching (the one tolerance policy).
RELATIVE_TOLERANCE = 1e-9

#: An inner angle of a valid element lies strictly between these two, in radians.
MIN_ELEMENT_ANGLE = 0.01 * np.pi
MAX_ELEMENT_ANGLE = 0.99 * np.pi


#: The least number of a range that is open at 0, and the most of a count that nothing else bounds.
TINY, COUNT = 1e-9, 10**12

#: What the density term of the reward can be, in the order that compiled code numbers them.
DENSITIES = ("continuous", "printed", "local")
#: What lengths in action and observation are measured by.
SCALES = ("front", "size")
#: Where the paper and the code that its authors released differ: the one or the other.
SOURCES = ("printed", "released")


class DomainError(UserError, ValueError):
    """A polygon that cannot be meshed; the message names the source, the place and the fix."""


@dataclass(frozen=True)
class Domain:
    """A polygonal domain as one counter-clockwise ring of boundary vertices.

    A polygon with holes is one ring through seams: zero-width bridges walked once in each direction, so that
    their points occur twice in ``ring``. Both sides of a seam are the same points, hence the same mesh vertices.

    Attributes:
        name: what messages, tables and files call it.
        points: (p, 2) float64, the distinct points, in the input's coordinates and units, never rounded.
        ring: (n,) int64, indices into ``points`` in counter-clockwise order, n even.
        segments: (s, 2) int64, indices into ``points`` of the given boundary segments (the ring's edges without
            the seams'); the mesh keeps them exactly.
        deviation: how far the given outline lies off the segments at most, where an edge length or a size split it; in
            domain units.
        lines: (l, 2) int64, indices into ``points`` of the segments inside that are edges of the mesh, each once; the
            ring walks them in both directions.
        held: (h,) int64, points inside that stay where they are, as nodes of the mesh.
    """

    name: str
    points: Floats
    ring: Ints
    segments: Ints
    deviation: float = 0.0
    lines: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    held: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def kept(self) -> Ints:
        """(s + l, 2) int64: the given segments, of the boundary and of lines, each once."""
        return np.concatenate([self.segments, self.lines])

    @property
    def vertices(self) -> Floats:
        """(n, 2) float64: the ring's coordinates in counter-clockwise order, seam points twice."""
        return self.points[self.ring]

    @property
    def area(self) -> float:
        """Enclosed area (shoelace formula; holes are subtracted by the ring's orientation)."""
        x, y = (self.vertices - self.points[0]).T
        return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))

    @property
    def diameter(self) -> float:
        """Diagonal of the bounding box, the length that tolerances are scaled by."""
        return float(np.linalg.norm(self.points.max(axis=0) - self.points.min(axis=0)))


@dataclass(frozen=True, eq=False)
class WantedSizes:
    """What a user says of the edge length wanted inside a domain, beyond what its boundary says.

    Attributes:
        least: in domain units, at least 0: elements grow inwards to it from a finer boundary.
        most: in domain units, above 0: they grow to it, or shrink inwards to it from a coarser boundary; infinite: they
            grow to the largest size of the boundary, or to ``least``.
        points: (m, 3) float64, x, y and a size: elements are no larger there, and grow from there as from a boundary.

    Raises:
        UserError: no positive number, the least above the most, or points that are none.
    """

    least: float = 0.0
    most: float = math.inf
    points: Floats = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        points = np.asarray(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all() or not (points[:, 2] > 0.0).all():
            raise UserError("points with sizes: give (m, 3) finite numbers, x, y and a size above 0 in each row")
        object.__setattr__(self, "points", points)
        if not (0.0 <= self.least < math.inf and self.most > 0.0):
            raise UserError(
                f"least size {self.least:g} and largest size {self.most:g}: give --min-size (min_size= in Python) and "
                "--max-size (max_size= in Python) positive numbers in the polygon's units"
            )
        if self.least > self.most:
            raise UserError(
                f"least size {self.least:g} above largest size {self.most:g}: give --min-size at most --max-size "
                "(min_size=, max_size= in Python)"
            )

    def clipped(self, sizes: Floats) -> Floats:
        """Sizes within the bounds."""
        return np.clip(sizes, self.least, self.most)

    @property
    def stated(self) -> bool:
        """Whether anything is said."""
        return self.least > 0.0 or self.most < math.inf or len(self.points) > 0


#: Nothing said.
NO_WISHES = WantedSizes()


class Curve(Protocol):
    """A smooth curve that a polyline stands for, exact."""

    def nearest(self, points: Floats, /) -> Floats:
        """(m,) parameters of the curve's nearest places to (m, 2) points."""

    def at(self, parameters: Floats, /) -> Floats:
        """(m, 2) places on the curve at (m,) parameters."""

    def between(self, a: Floats, b: Floats, fractions: Floats, /) -> Floats:
        """(m, f, 2) places at (f,) fractions of the curve's length from (m, 2) places a on it to b, the shorter way."""


class DomainSupply(Protocol):
    """An endless supply of domains: what an episode can be begun on in place of one domain.

    Attributes:
        name: what tasks and curricula call it.
        vertices: most ring vertices of a domain drawn, seams included.
        elements: most elements a domain drawn may be expected to need.
    """

    @property
    def name(self) -> str: ...

    @property
    def vertices(self) -> int: ...

    @property
    def elements(self) -> int: ...

    def draw(self, random: np.random.Generator) -> Domain:
        """The next domain."""


@dataclass(frozen=True)
class Setting:
    """What one setting accepts.

    Attributes:
        kind: bool, int, float or str.
        low, high: inclusive range of numbers.
        words: texts that are accepted; for a number, in its place.
        optional: whether None, which is null in YAML and JSON, is accepted.
        meaning: in words, with the unit.
    """

    kind: type
    low: float = -math.inf
    high: float = math.inf
    words: tuple[str, ...] = ()
    optional: bool = False
    meaning: str = ""

    def fitted(self, value: Any) -> Any:
        """The value in the setting's type; whole numbers may be given as floats.

        Raises:
            ValueError, OverflowError: it is of another type or out of range.
        """
        if value is None and self.optional:
            return None
        kind: type = self.kind
        if isinstance(value, str):
            kind, fits = str, value in self.words
        elif isinstance(value, bool | np.bool_):
            fits = kind is bool
        else:
            number = isinstance(value, int | float | np.integer | np.floating)
            fits = number and kind in (int, float) and self.low <= value <= self.high
        if not fits or kind(value) != value:
            raise ValueError(value)
        return kind(value)

    def __str__(self) -> str:
        """What is accepted, in words: the part of a message that tells the fix."""
        span = "" if math.isinf(self.low) else f" in [{self.low:.12g}, {self.high:.12g}]"
        plain = {bool: ["true or false"], int: [f"a whole number{span}"], float: [f"a number{span}"]}
        return " or ".join([*plain.get(self.kind, []), *self.words, *(["null"] if self.optional else [])])


def _setting(default: Any, meaning: str, low: float = -np.inf, high: float = np.inf, **accepts: Any) -> Any:
    """A field of MeshingParameters: its default, what it means and what it may be."""
    kind = int if default is None else type(default)
    return field(default=default, metadata={"setting": Setting(kind, low, high, meaning=meaning, **accepts)})


@dataclass(frozen=True)
class MeshingParameters:
    """Every number of the MDP, by the paper's symbols (defaults: the paper's choice, O2 and R2).

    The table below is the one place for what each means and may be: `SETTINGS` holds it, and whatever else checks or
    describes a setting of the environment takes it from there.

    Raises:
        ValueError: a value of another type, or out of its range.
    """

    n: int = _setting(2, "neighbours observed on each side of the reference vertex", 1, 8)
    g: int = _setting(3, "fan slices", 1, 16)
    beta: float = _setting(6.0, "fan radius over base length", 1e-3, 1e3)
    n_rv: int = _setting(2, "neighbour pairs averaged for the choice of the reference vertex", 1, 8)
    alpha: float = _setting(2.0, "action radius over base length", 1e-3, 1e3)
    scale: Literal["front", "size"] = _setting(
        "front",
        "what lengths in action and observation are in units of; front: the paper's base length, the mean of the front "
        "edges around V_0; size: ours, the edge length wanted at V_0, and the observation tells that around and ahead",
        words=SCALES,
    )
    size_gradient: float = _setting(
        0.2, "ours: how much the edge length wanted may grow over a distance, from the boundary inwards", TINY, 10.0
    )
    upsilon: float = _setting(1.0, "density weight, 0.5 dense, 1 medium, 1.5 sparse", TINY, 10.0)
    kappa: float = _setting(4.0, "divisor in A_max", TINY, 1e9)
    density: Literal["continuous", "printed", "local"] = _setting(
        "continuous",
        "continuous: (A - A_max)/(A_max - A_min); printed: the paper's (A - A_min)/(A_max - A_min); "
        "local: ours, A against the area wanted there, by the boundary edges nearby",
        words=DENSITIES,
    )
    area_range: Literal["printed", "released"] = _setting(
        "printed",
        "printed: A_min and A_max by the shortest and longest boundary edge; released: as in the authors' code, by the "
        "second ones, at most L/sqrt(2) and 2 L, L the mean edge",
        words=SOURCES,
    )
    M_angle: float = _setting(np.pi / 3, "radians; front angles below it are penalised", TINY, np.pi)
    boundary: Literal["printed", "released"] = _setting(
        "printed",
        "printed: eta_b as in the paper; released: as in the authors' code, with a factor for the new edges' length "
        "against the edges around",
        words=SOURCES,
    )
    invalid: Literal["printed", "released"] = _setting(
        "printed",
        "reward of an invalid action; printed: the paper's -0.1; released: the authors' code's, -1 over the elements "
        "so far",
        words=SOURCES,
    )
    extended: bool = _setting(
        False, "ours: the observation tells the elements vertices lack to be regular, and the size wanted"
    )
    irregular: float = _setting(0.0, "ours: weight of the reward's term for irregular vertices", 0.0, 10.0)
    type2: bool = _setting(False, "true: actions may add two vertices (Box of 5 in place of 3)")
    max_invalid: int = _setting(100, "invalid actions in a row before truncation", 1, 10**9)
    max_elements: int | None = _setting(
        None,
        "elements before truncation; null: four times the domain's area in squares of its mean edge, plus its ring",
        1,
        COUNT,
        optional=True,
    )

    def __post_init__(self) -> None:
        for name, setting in SETTINGS.items():
            value = getattr(self, name)
            try:
                object.__setattr__(self, name, setting.fitted(value))
            except (ValueError, OverflowError):
                raise ValueError(f"MeshingParameters.{name} = {value!r:.40}: must be {setting}") from None

    @property
    def action_size(self) -> int:
        """3, or 5 with type 2."""
        return 5 if self.type2 else 3

    @property
    def sized(self) -> bool:
        """Whether lengths are in units of the edge length wanted."""
        return self.scale == "size"

    @property
    def drift(self) -> bool:
        """Whether the observation tells the base length over the edge length wanted."""
        return self.extended or self.sized

    @property
    def uses_sizes(self) -> bool:
        """Whether the edge length wanted matters anywhere."""
        return self.drift or self.density == "local"


#: What each of the MDP's numbers means and may be, by name, in order.
SETTINGS: dict[str, Setting] = {entry.name: entry.metadata["setting"] for entry in fields(MeshingParameters)}

#: The paper's names for observation ranges and action radii: option -> name -> the numbers that it stands for.
NAMED: dict[str, dict[str, dict[str, float]]] = {
    "observation": {
        "O1": {"beta": 4.0, "n": 2, "g": 3},
        "O2": {"beta": 6.0, "n": 2, "g": 3},
        "O3": {"beta": 6.0, "n": 3, "g": 4},
    },
    "radius": {"R1": {"alpha": 1.0}, "R2": {"alpha": 2.0}, "R3": {"alpha": 3.0}},
}
