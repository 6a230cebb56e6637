"""A patch on trial: filled in the ways that promise most, settled, and exchanged when the mesh is better for it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inlined, inner
from envs.mdp.size_field import SizeField
from envs.types import Floats, Ints
from freemesh_ray.finish.cleanup import FLOOR
from freemesh_ray.finish.halfedges import Halfedges
from freemesh_ray.finish.optimiser import cost_of
from freemesh_ray.finish.refill import options
from freemesh_ray.finish.refill import ring_filling as fill
from freemesh_ray.finish.refill.annulus import list_rings, rings
from freemesh_ray.finish.refill.exchange import Exchange, exchange_of, link, make_way
from freemesh_ray.finish.refill.growth import LOOP, OUTER, SIZE, WORK, Growth, growth_of
from freemesh_ray.finish.refill.patterns import Patterns, assess, list_patterns, patterns_of
from freemesh_ray.finish.refill.placement import Placement, place, placement_of
from freemesh_ray.finish.refill.region import (
    FREE,
    VERTICES,
    Region,
    copy_new,
    copy_old,
    price,
    rate,
    region_of,
    settle,
    surround,
)
from freemesh_ray.finish.refill.ring_filling import (
    Filling,
    begin,
    cut,
    edge_length,
    filling_of,
    rectangle,
    row,
    toggled_star,
)

#: Options that get places, and those of them that are settled, at most; of the whole domain; of a large one the first
#: number falls to as many as have SHARED elements together, but not below LEAST, and the second to 1.
PLACED, SETTLED = (12, 40), (2, 6)
SHARED, LEAST = 400_000, 3
#: Steps of conjugate gradients to the places that options are ranked by, and to those that they are settled from.
ROUGHLY, WELL = 12, 60
#: The second for the whole domain.
WELL_IN_DOMAIN = 400
#: Steps of the first descent, after which a filling is given up that costs too much by MARGIN for every 100 elements;
#: of the second; of those of the whole domain, for which there is no margin.
STEPS, STEPS_OF_DOMAIN, MARGIN = (6, 30), (30, 150), 0.6
#: A whole domain with more elements than this is a large one.
LARGE = 25_000
#: Descents end when a step lowers the cost by less than this share: the first, the second, that of the whole domain.
LEAST_FALL = (1e-3, 3e-4, 2e-5)
#: What an irregular vertex counts against the cost when fillings are ranked by their first places.
RANKED = 0.2
#: What an element costs more in a whole domain that has e times as many.
FINER = 0.03
#: What the cost may rise by for each irregular vertex less, and must fall by when there is none less.
WORTH, GAIN = 0.2, 0.15
#: Patches on trial that are remembered, at most.
SEEN = 1 << 16
#: A patch is tried again when it has grown by this, or has more irregular vertices inside.
STRIDE = 1.12
#: Work that placing one element takes at each step, in parts of a descent's.
PLACING = 8


class Trial(NamedTuple):
    """Working memory.

    Attributes:
        growth, filling, patterns, placement, region, exchange: of their files.
        ranked: (PLACED, 2) float64, costs of the options that were placed, and which they are.
        seen: (SEEN,) int64, patches that were tried, by a number that tells their elements.
        state: (4,) int64, of the patch that grows: irregular vertices and size at its last trial; patches exchanged;
            patches tried.
        level: (1,) float64, cost of an element that makes the mesh neither better nor worse.
    """

    growth: Growth
    filling: Filling
    patterns: Patterns
    placement: Placement
    region: Region
    exchange: Exchange
    ranked: Floats
    seen: Ints
    state: Ints
    level: Floats


# Entries of Trial.state.
IRREGULAR, TRIED_SIZE, EXCHANGED, TRIED = range(4)


def trial_of(mesh: Halfedges, wanted: SizeField, elements: int, level: float) -> Trial:
    """Room for fillings of so many elements, for which such sizes are wanted."""
    filling = filling_of(elements)
    return Trial(
        growth=growth_of(mesh), filling=filling, patterns=patterns_of(elements),
        placement=placement_of(filling), region=region_of(mesh, filling, wanted), exchange=exchange_of(mesh, filling),
        ranked=np.zeros((max(PLACED), 2)), seen=np.zeros(SEEN, dtype=np.int64), state=np.zeros(4, dtype=np.int64),
        level=np.array([level]),
    )  # fmt: skip


@inner
def irregular_inside(mesh: Halfedges, growth: Growth) -> int:
    """Corners of the patch's elements that lie in irregular vertices inside the domain."""
    count = 0
    for i in range(growth.counts[SIZE]):
        for c in range(4):
            v = mesh.quads[growth.members[i], c]
            count += 1 if mesh.degree[v] != 4 and not mesh.rim[v] else 0
    return count


@inner
def is_new(mesh: Halfedges, trial: Trial, drop: int) -> bool:
    """Whether the patch was not tried before, as far as is remembered."""
    growth, key = trial.growth, drop + 1
    for i in range(growth.counts[SIZE]):
        quad = growth.members[i]
        scrambled = ((quad * 0x9E3779B1) ^ (trial.exchange.version[quad] * 0x85EBCA6B)) & 0x7FFFFFFF
        scrambled = ((scrambled ^ (scrambled >> 15)) * 0x45D9F3B) & 0x7FFFFFFF
        key += scrambled ^ (scrambled >> 16)
    key = (key << 1) | 1
    at = (key >> 1) & (SEEN - 1)
    for _ in range(8):
        if trial.seen[at] == key:
            return False
        if trial.seen[at] == 0:
            break
        at = (at + 1) & (SEEN - 1)
    trial.seen[at] = key
    return True


@inner
def build(mesh: Halfedges, trial: Trial, option: Floats, steps: int) -> None:
    """Fill the patch as an option says, its vertices so many steps on their way to where they are harmonic."""
    growth, filling = trial.growth, trial.filling
    begin(mesh, growth, filling)
    kind, first, second = int(option[options.KIND]), int(option[options.FIRST]), int(option[options.SECOND])
    third, fourth = int(option[options.THIRD]), int(option[options.FOURTH])
    if kind == options.RECTANGLE:
        h = edge_length(filling, filling.loop, filling.counts[fill.LENGTH])
        for _ in range(first):
            row(filling, h)
        rectangle(filling, filling.loop, filling.counts[fill.LENGTH], second, third)
    elif kind == options.STAR:
        toggled_star(filling, first)
    elif kind == options.CUT:
        cut(filling, first, second, third, fourth // 3, fourth % 3)
    else:
        rings(filling, first, second, third)
    taken = place(filling, trial.placement, growth.counts[LOOP], steps)
    growth.counts[WORK] += filling.counts[fill.QUADS] * (taken + 2) // PLACING


@inlined
def filling_cost(trial: Trial) -> float:
    """The cost of the filling as it is placed."""
    filling = trial.filling
    n, m = filling.counts[fill.VERTICES], filling.counts[fill.QUADS]
    trial.growth.counts[WORK] += m
    return cost_of(filling.xy[:n], filling.quads[:m], trial.region.descent)


@inlined
def _insert(ranked: Floats, count: int, value: float, option: float) -> None:
    """Put an option among those that are ranked, by its value."""
    at = count
    while at > 0 and ranked[at - 1, 0] > value:
        ranked[at, 0], ranked[at, 1] = ranked[at - 1, 0], ranked[at - 1, 1]
        at -= 1
    ranked[at, 0], ranked[at, 1] = value, option


@inner
def rank(mesh: Halfedges, trial: Trial, count: int, placed: int) -> int:
    """Place the first options, and sort them by cost and irregular vertices; how many there are."""
    for i in range(min(count, placed)):
        option = trial.patterns.options[i]
        build(mesh, trial, option, ROUGHLY)
        value = filling_cost(trial) - trial.level[0] * trial.filling.counts[fill.QUADS]
        if not value < math.inf:
            value = 1e6
        _insert(trial.ranked, i, value + RANKED * option[options.LEFT], float(i))
    return min(count, placed)


@inner
def rank_settled(mesh: Halfedges, trial: Trial, count: int) -> int:
    """Settle what was ranked for the whole domain a little, and sort it by the mean cost then; how many are left."""
    left = 0
    for i in range(count):
        chosen = trial.ranked[i, 1]
        option = trial.patterns.options[int(chosen)]
        build(mesh, trial, option, WELL_IN_DOMAIN)
        if link(mesh, trial.growth, trial.filling, trial.exchange):
            copy_new(mesh, trial.growth, trial.region, trial.filling)
            quads = trial.filling.counts[fill.QUADS]
            value = settle(trial.growth, trial.region, STEPS_OF_DOMAIN[0], LEAST_FALL[0]) / quads
            value += FINER * math.log(quads) + RANKED * option[options.LEFT] / trial.growth.counts[SIZE]
            _insert(trial.ranked, left, value, chosen)
            left += 1
    return left


@inner
def accept(mesh: Halfedges, trial: Trial) -> None:
    """Exchange the patch for the linked filling, everything where it settled."""
    growth, filling, region, loop = trial.growth, trial.filling, trial.region, trial.growth.counts[LOOP]
    make_way(mesh, growth, filling, trial.exchange)
    for i in range(region.counts[FREE]):
        v = region.vertices[i]
        v = v if v >= 0 else trial.exchange.vertex[-1 - v]
        mesh.xy[v, 0], mesh.xy[v, 1] = region.xy[i, 0], region.xy[i, 1]
    for v in range(loop):
        growth.loop[v] = 0
    trial.state[EXCHANGED] += 1


@inner
def try_patch(mesh: Halfedges, trial: Trial, drop: int, whole: bool) -> bool:
    """Try to fill the patch better; whether that was done, and the patch is empty.

    Args:
        mesh: changed when it was.
        trial: working memory, with the patch and its loop.
        drop: irregular vertices that must become less.
        whole: whether the patch is the whole domain.
    """
    growth, region, state = trial.growth, trial.region, trial.state
    inside = irregular_inside(mesh, growth)
    if inside == state[IRREGULAR] and growth.counts[SIZE] < STRIDE * state[TRIED_SIZE]:
        return False
    state[IRREGULAR], state[TRIED_SIZE] = inside, growth.counts[SIZE]
    if inside == 0 or not is_new(mesh, trial, drop):
        return False
    least = assess(mesh, growth, trial.patterns)
    before = trial.patterns.before[0]
    if before - drop < least - 1e-9:
        return False
    most = before - drop + 1e-9
    if growth.counts[LOOP] > growth.counts[OUTER]:
        count = list_rings(mesh, growth, trial.filling, trial.patterns, most, whole)
    else:
        count = list_patterns(mesh, growth, trial.filling, trial.patterns, most, whole)
    if count == 0:
        return False
    state[TRIED] += 1
    surround(mesh, growth, region)
    copy_old(mesh, growth, region)
    old, elements, guard = price(growth, region), growth.counts[SIZE], min(rate(region), FLOOR)
    large = elements > LARGE
    count = rank(mesh, trial, count, min(PLACED[1], max(LEAST, SHARED // elements)) if whole else PLACED[0])
    count = min(count, (1 if large else SETTLED[1]) if whole else SETTLED[0])
    if count > 1 and whole:
        count = rank_settled(mesh, trial, count)
    for i in range(min(count, SETTLED[0])):
        option = trial.patterns.options[int(trial.ranked[i, 1])]
        build(mesh, trial, option, WELL_IN_DOMAIN if whole else WELL)
        if not link(mesh, growth, trial.filling, trial.exchange):
            continue
        copy_new(mesh, growth, region, trial.filling)
        fewer = before - option[options.LEFT]
        limit = old + trial.level[0] * (trial.filling.counts[fill.QUADS] - elements)
        limit += WORTH * fewer if fewer > 0.5 else -GAIN
        margin = MARGIN * max(1.0, region.counts[VERTICES] / 100.0)
        if not whole and not settle(growth, region, STEPS[0], LEAST_FALL[0]) < limit + margin:
            continue
        steps, least_fall = STEPS_OF_DOMAIN[1] if whole else STEPS[1], LEAST_FALL[2 if whole else 1]
        if settle(growth, region, steps, least_fall) < limit and rate(region) >= guard:
            accept(mesh, trial)
            return True
    return False
