"""Frozen parameter and state types shared by the meshing world.

Everything here is plain data: shapes, units and ranges stand beside each field.
Symbols are those of Pan, Huang, Cheng, Zeng (2023), Neural Networks 157.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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


#: What the density term of the reward can be, in the order that compiled code numbers them.
DENSITIES = ("continuous", "printed", "local")


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
    """

    name: str
    points: Floats
    ring: Ints
    segments: Ints

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


@dataclass(frozen=True)
class MeshingParameters:
    """Every number of the MDP (defaults: the paper's choice, O2 and R2).

    Attributes:
        n: neighbours observed on each side of the reference vertex, n >= 1.
        g: fan slices, g >= 1.
        beta: fan radius over base length, L_r = beta L.
        n_rv: neighbour pairs averaged for the choice of the reference vertex.
        alpha: action radius over base length, r = alpha L (R1: 1, R2: 2, R3: 3).
        upsilon: density weight in (0, 10]; 0.5 dense, 1 medium, 1.5 sparse.
        kappa: divisor in A_max.
        density: ``"continuous"`` is (A - A_max)/(A_max - A_min); ``"printed"`` the paper's (A - A_min)/(A_max - A_min);
            ``"local"`` (ours) compares A with the area wanted there, by the lengths of the boundary edges nearby.
        M_angle: radians; angles left on the front below it are penalised.
        extended: whether the observation also tells how many elements V_0 and its 2 n neighbours lack to be regular,
            and how L compares with the edge length wanted there (ours, not the paper's).
        irregular: weight of the reward's term for irregular vertices (ours, not the paper's), in [0, 10].
        type2: whether actions may add two vertices (Box of 5 in place of 3).
        max_invalid: invalid actions in a row before truncation.
        max_elements: elements before truncation; None: four times the domain's area in mean-length squares, plus n.
    """

    n: int = 2
    g: int = 3
    beta: float = 6.0
    n_rv: int = 2
    alpha: float = 2.0
    upsilon: float = 1.0
    kappa: float = 4.0
    density: Literal["continuous", "printed", "local"] = "continuous"
    M_angle: float = np.pi / 3
    extended: bool = False
    irregular: float = 0.0
    type2: bool = False
    max_invalid: int = 100
    max_elements: int | None = None

    def __post_init__(self) -> None:
        for name, low, high in (
            ("n", 1, 8), ("g", 1, 16), ("n_rv", 1, 8), ("beta", 1e-3, 1e3), ("alpha", 1e-3, 1e3),
            ("upsilon", 1e-9, 10.0), ("kappa", 1e-9, 1e9), ("M_angle", 1e-9, np.pi), ("irregular", 0.0, 10.0),
            ("max_invalid", 1, 10**9),
        ):  # fmt: skip
            value = getattr(self, name)
            if name in ("n", "g", "n_rv", "max_invalid") and int(value) != value:
                raise ValueError(f"MeshingParameters.{name} = {value!r}: must be a whole number")
            if not low <= value <= high:
                raise ValueError(f"MeshingParameters.{name} = {value!r}: must lie in [{low}, {high}]")
        if self.density not in DENSITIES:
            raise ValueError(f"MeshingParameters.density = {self.density!r}: use one of {', '.join(DENSITIES)}")
        if self.max_elements is not None and self.max_elements < 1:
            raise ValueError(f"MeshingParameters.max_elements = {self.max_elements!r}: must be at least 1, or None")

    @property
    def observation_size(self) -> int:
        """4 n + 2 g + 1 (15 for O2), and 2 n + 2 more when extended."""
        return 4 * self.n + 2 * self.g + 1 + (2 * self.n + 2 if self.extended else 0)

    @property
    def action_size(self) -> int:
        """3, or 5 with type 2."""
        return 5 if self.type2 else 3


#: The paper's named observation ranges and action radii.
OBSERVATIONS: dict[str, dict[str, float]] = {
    "O1": {"beta": 4.0, "n": 2, "g": 3},
    "O2": {"beta": 6.0, "n": 2, "g": 3},
    "O3": {"beta": 6.0, "n": 3, "g": 4},
}
RADII: dict[str, float] = {"R1": 1.0, "R2": 2.0, "R3": 3.0}
