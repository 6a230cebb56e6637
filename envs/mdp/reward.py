"""The reward's named terms (paper, section "Reward function") and the two constants beside them.

r = -0.1                    invalid action
    10                      the element that completes the mesh
    eta_e + eta_b + mu      otherwise; of ours, with a weight that is 0 by default, the term nu

The code that the authors released has other forms of two of them, which settings choose: `eta_b_released` and
`invalid_released`.
"""

from __future__ import annotations

import math

from envs.kernels.jit import inlined
from envs.mdp.action import Cut
from envs.mdp.front import GIVEN, Front
from envs.quality import eta_from_angles

INVALID_REWARD = -0.1
LAST_REWARD = 10.0


@inlined
def element_area(cut: Cut) -> float:
    """Area of the element, in squared domain units."""
    x, y = cut.x, cut.y
    return 0.5 * ((x[2] - x[0]) * (y[3] - y[1]) - (x[3] - x[1]) * (y[2] - y[0]))


@inlined
def eta_e(cut: Cut) -> float:
    """Element quality in [0, 1]."""
    x, y, a = cut.x, cut.y, cut.angles
    return eta_from_angles(x[0], y[0], x[1], y[1], x[2], y[2], x[3], y[3], a[0], a[1], a[2], a[3])


@inlined
def eta_b(cut: Cut, M_angle: float) -> float:
    """Quality of the front that is left, in [-1, 0]: its new angles, and how near the new vertices come to it.

    sqrt(min_k min(sigma_k, M_angle) / M_angle q_dist) - 1 with q_dist = d_min / ((d_1 + d_2)/2) capped at 1, where d_1
    and d_2 are the lengths of the edges from new vertices to the chain. Front edges at the chain's two ends do not
    count towards d_min: their nearness is what the angles sigma measure. For type 0, q_dist = 1.
    """
    q_angle = min(min(cut.sigma_start, cut.sigma_end), M_angle) / M_angle
    q_dist = 1.0
    if cut.k < 3:
        x, y, k = cut.x, cut.y, cut.k
        d_1 = math.hypot(x[k + 1] - x[k], y[k + 1] - y[k])
        d_2 = math.hypot(x[0] - x[3], y[0] - y[3])
        q_dist = min(1.0, cut.d_min / (0.5 * (d_1 + d_2)))
    return math.sqrt(q_angle * q_dist) - 1.0


@inlined
def eta_b_released(front: Front, cut: Cut, M_angle: float) -> float:
    """eta_b as the authors' code has it: the factors' geometric mean, with one for the new edges' length, less 1.

    Args:
        front: before the element is cut.
        cut: the element.
        M_angle: rad.
    """
    quality = eta_b(cut, M_angle) + 1.0
    factors = 2.0 if cut.k == 3 else 3.0
    return math.pow(quality * quality * size_factor(front, cut), 1.0 / factors) - 1.0


@inlined
def size_factor(front: Front, cut: Cut) -> float:
    """How near the new edges' length is to that of the front's edges around, in (0, 1]: the less over the greater.

    Around are, as the authors have it, the new edges themselves and next to them one edge on each side; two for type 0,
    which has one new edge.
    """
    x, y, k = cut.x, cut.y, cut.k
    first = last = cut.start
    for _ in range(k):
        last = front.nxt[last]
    sides = 2 if k == 3 else 1
    total = 0.0
    for _ in range(sides):
        before, after = front.prv[first], front.nxt[last]
        total += math.hypot(front.xy[before, 0] - front.xy[first, 0], front.xy[before, 1] - front.xy[first, 1])
        total += math.hypot(front.xy[after, 0] - front.xy[last, 0], front.xy[after, 1] - front.xy[last, 1])
        first, last = before, after
    edges = 4 - k
    new = 0.0
    for i in range(k, 4):
        j = (i + 1) & 3
        new += math.hypot(x[j] - x[i], y[j] - y[i])
    around, own = (total + new) / (2 * sides + edges), new / edges
    return min(around, own) / max(around, own)


@inlined
def invalid_released(elements: int) -> float:
    """Reward of an invalid action in the authors' code, after so many elements."""
    return -1.0 / max(1, elements)


@inlined
def mu(area: float, A_min: float, A_max: float, continuous: bool) -> float:
    """Density: -1 below A_min, 0 from A_max on; between, in [-1, 0] (continuous) or, as printed, in [0, 1]."""
    if area < A_min:
        return -1.0
    if area >= A_max:
        return 0.0
    return (area - (A_max if continuous else A_min)) / (A_max - A_min)


@inlined
def mu_local(front: Front, cut: Cut, area: float, upsilon: float) -> float:
    """Density by the sizes around (ours): -log2(A / A_wanted)^2, at least -1: a factor of 2 costs as much as can be.

    A_wanted = v s^2 with s the mean edge length wanted at the chain's vertices. The observation is free of scale, so
    what the agent is paid for must be, too: bounds of the whole domain's edges are not seen from the front.
    """
    slot, total = cut.start, 0.0
    for _ in range(cut.k + 1):
        total += front.size[front.vid[slot]]
        slot = front.nxt[slot]
    wanted = total / (cut.k + 1)
    return -min(1.0, math.log2(max(area, 1e-300) / (upsilon * wanted * wanted)) ** 2)


@inlined
def nu(front: Front, cut: Cut) -> float:
    """Irregularity, at most 0: elements too many or too few at the new vertices that the element takes off the front.

    What leaves the front has all its elements but this one. The domain's given points do not count: where
    the boundary turns, elements cannot meet evenly.

    Args:
        front: before the element is cut.
        cut: the element.
    """
    total = 0
    slot = cut.start
    for _ in range(cut.k - 1):
        slot = front.nxt[slot]
        if front.vid[slot] >= front.counts[GIVEN]:
            total -= abs(front.need[front.vid[slot]] - 1)
    return float(total)
