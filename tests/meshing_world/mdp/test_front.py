"""The front under play: what holds after every accepted element, whatever the domain, and of every finished mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from checkout import REFERENCES
from play import coordinates, generic, turns

from envs.domains.load import load
from envs.kernels import slot_tree
from envs.mdp import front as fr
from envs.mdp.front import AREA, AREA_0, ELEMENTS, FREE, INVALID, OUTSIDE, POINTS, RETURN, RING, STEPS, Front
from envs.mesh import Mesh
from envs.types import MAX_ELEMENT_ANGLE, MIN_ELEMENT_ANGLE, Domain, Floats, MeshingParameters

pytestmark = pytest.mark.slow

#: Domain, seed, options. random:3 and D9 have seams; 11 and 20 are small enough for several games.
GAMES = [
    ("T1", 0, {}), ("T2", 0, {}), ("T3", 1, {}), ("random:5", 0, {}),
    ("random:3", 0, {}), ("random:3", 1, {}), ("random:58?holes=2&vertices=60", 0, {}),
    ("random:11", 0, {"n_rv": 1}), ("random:11", 1, {"n_rv": 4, "alpha": 1.0}), ("random:20", 0, {"n_rv": 8}),
    ("T1", 0, {"type2": True}), ("T1", 1, {"type2": True}), ("random:8", 0, {"type2": True}),
    ("random:20", 1, {"type2": True}), ("random:3", 2, {"type2": True}),
    ("random:4?holes=1&vertices=40", 0, {"type2": True}),
]  # fmt: skip


def mean_angles(ring: Floats, n_rv: int) -> Floats:
    """The mean angle at every vertex of a ring, by the definition."""
    z = ring @ [1.0, 1.0j]
    total = np.zeros(len(z))
    for j in range(1, n_rv + 1):
        right, left = np.roll(z, -j) - z, np.roll(z, j) - z
        total += np.angle(left * right.conj()) % (2.0 * np.pi)
    return total / n_rv


def area_of(ring: Floats) -> float:
    x, y = (ring - ring[0]).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def region(ring: Floats) -> shapely.Geometry:
    """What a ring encloses, seams or not."""
    return shapely.make_valid(shapely.Polygon(ring), method="structure")


def assert_linked(front: Front) -> None:
    """Every slot is in the ring or in the list of free ones, once."""
    slots = len(front.vid)
    ring = np.flatnonzero(front.prv != OUTSIDE)
    assert len(ring) == front.counts[RING]
    walked = fr.ring_slots(front)
    assert sorted(walked.tolist()) == ring.tolist()
    np.testing.assert_array_equal(front.nxt[walked], np.roll(walked, -1))
    np.testing.assert_array_equal(front.prv[walked], np.roll(walked, 1))
    free, slot = [], int(front.counts[FREE])
    while slot < slots:
        free.append(slot)
        slot = int(front.nxt[slot])
    assert sorted([*free, *ring.tolist()]) == list(range(slots))
    np.testing.assert_array_equal(front.points[front.vid[walked]], front.xy[walked])


def assert_indexed(front: Front, n_rv: int) -> None:
    """The trees, updated element by element, are those of a fresh build; the least mean angle is the reference's."""
    fresh = front._replace(key=np.full_like(front.key, np.nan), box=np.full_like(front.box, np.nan))
    fr._index(fresh, n_rv)
    np.testing.assert_array_equal(front.key[1:], fresh.key[1:])
    np.testing.assert_array_equal(front.box[1:], fresh.box[1:])
    keys = front.key[len(front.vid) :]
    assert fr.reference_slot(front) == np.argmin(keys)
    ring = fr.ring_slots(front)
    difference = mean_angles(front.xy[ring], n_rv) - keys[ring]
    # Angles of 0 and of a full turn are one where two vertices of the ring lie on one ray or in one place.
    turn = 2.0 * np.pi / n_rv
    np.testing.assert_allclose((difference + 0.5 * turn) % turn - 0.5 * turn, 0.0, atol=2e-9)


def assert_planar(front: Front, seams: bool) -> None:
    """The front crosses itself nowhere, and touches itself only along seams."""
    ring = coordinates(front)
    if not seams:
        polygon = shapely.Polygon(ring)
        assert polygon.is_valid
        assert polygon.exterior.is_ccw
        return
    ends = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) @ [1.0, 1.0j]
    edges = np.unique(np.sort(ends, axis=1), axis=0)
    lines = shapely.linestrings(edges.view(float).reshape(-1, 2, 2))
    assert shapely.get_num_geometries(shapely.union_all(lines)) == len(lines)


def assert_element(before: Front, after: Front, tol: float) -> None:
    """The element cut last is strictly convex, has fit angles and lies inside the front that it was cut from."""
    corners = after.points[after.quads[before.counts[ELEMENTS]]]
    z = corners @ [1.0, 1.0j]
    angles = np.angle((np.roll(z, 1) - z) / (np.roll(z, -1) - z))
    assert angles.min() > MIN_ELEMENT_ANGLE
    assert angles.max() < MAX_ELEMENT_ANGLE
    assert shapely.Polygon(corners).exterior.is_ccw
    assert region(coordinates(before)).buffer(tol).covers(shapely.Polygon(corners))


def assert_areas(front: Front) -> None:
    """What is left and what is cut add up to the domain."""
    quads = front.quads[: front.counts[ELEMENTS]]
    cut = sum(area_of(front.points[quad]) for quad in quads)
    assert front.measure[AREA] + cut == pytest.approx(front.measure[AREA_0], rel=1e-9)
    if front.counts[RING]:
        assert front.measure[AREA] == pytest.approx(area_of(coordinates(front)), abs=1e-9 * front.measure[AREA_0])


def assert_unchanged(before: Front, after: Front) -> None:
    """A rejected action has changed the counters of steps and invalid actions and the return, and nothing else."""
    for name in Front._fields[:-2]:
        np.testing.assert_array_equal(getattr(before, name), getattr(after, name))
    count, measure = before.counts.copy(), before.measure.copy()
    count[[INVALID, STEPS]] += 1
    measure[RETURN] += -0.1
    np.testing.assert_array_equal(count, after.counts)
    np.testing.assert_array_equal(measure, after.measure)


def assert_partition(domain: Domain, front: Front) -> None:
    """Elements and remaining front overlap nowhere, lie within the domain and fill it."""
    whole = region(domain.vertices)
    quads = front.quads[: front.counts[ELEMENTS]]
    parts = shapely.polygons(front.points[quads])
    if front.counts[RING]:
        parts = np.append(parts, region(coordinates(front)))
    assert shapely.area(parts).sum() == pytest.approx(domain.area, rel=1e-9)
    union = shapely.union_all(parts)
    assert union.area == pytest.approx(domain.area, rel=1e-9)
    assert whole.buffer(1e-9 * domain.diameter).covers(union)


def mesh_of(domain: Domain, front: Front) -> Mesh:
    return Mesh(
        domain.name,
        front.points[: front.counts[POINTS]].copy(),
        front.quads[: front.counts[ELEMENTS]].copy(),
        domain.segments,
        complete=front.counts[RING] == 0,
    )


def play(domain: Domain, seed: int, limit: int = 10_000, **options: object) -> Mesh:
    """Play a game, check every turn of it, and hand back its mesh."""
    seams = len(domain.ring) > len(domain.points)
    n_rv = options.get("n_rv", 2)
    last = None
    for turn in turns(domain, seed, limit=limit, **options):
        rejections = turn.episodes.out.rejection
        for i in np.flatnonzero(rejections)[:4]:
            assert_unchanged(turn.before, turn.episodes.front(i))
        if turn.chosen is None:
            continue
        last = turn.after
        assert_element(turn.before, last, 1e-9 * domain.diameter)
        assert_areas(last)
        if last.counts[RING]:
            assert_linked(last)
            assert_indexed(last, n_rv)
            assert_planar(last, seams)
    assert last is not None
    assert_partition(domain, last)
    mesh = mesh_of(domain, last)
    assert mesh.defects(domain.area) == []
    np.testing.assert_array_equal(mesh.vertices[: len(domain.points)], domain.points)
    return mesh


@pytest.mark.parametrize(("name", "seed", "options"), GAMES, ids=lambda value: str(value))
def test_a_game(name: str, seed: int, options: dict) -> None:
    play(load(name), seed, **options)


@pytest.mark.parametrize("seed", range(6))
def test_a_game_on_a_shaken_domain(seed: int) -> None:
    play(generic(f"random:{30 + seed}?vertices=40&holes={seed // 2}", seed, 0.1), seed, type2=seed % 2 == 1)


def test_a_long_game_around_a_seam() -> None:
    play(load("D9"), 0, limit=120)


@pytest.mark.parametrize("path", REFERENCES, ids=lambda path: path.stem)
def test_a_game_on_a_reference_domain(path: Path) -> None:
    play(load(path), 0, limit=40)


def test_games_end_in_whole_meshes() -> None:
    """Greedy play completes some of these, and every element of theirs, the last one included, is fit."""
    meshes = [play(load(name), seed) for name in ("random:11", "random:20") for seed in range(4)]
    complete = [mesh for mesh in meshes if mesh.complete]
    assert len(complete) >= 4
    for mesh in complete:
        z = mesh.vertices[mesh.quads] @ [1.0, 1.0j]
        angles = np.angle((np.roll(z, 1, axis=1) - z) / (np.roll(z, -1, axis=1) - z))
        assert angles.min() > MIN_ELEMENT_ANGLE
        assert angles.max() < MAX_ELEMENT_ANGLE
        used = np.unique(mesh.quads)
        np.testing.assert_array_equal(used, np.arange(len(mesh.vertices)))


def test_capacity_leaves_room_to_grow() -> None:
    domain = load("T1")
    for type2, factor in ((False, 1), (True, 2)):
        slots = fr.capacity(len(domain.ring), MeshingParameters(type2=type2))
        assert slots >= factor * len(domain.ring)
        assert slots & (slots - 1) == 0


def test_least_slot_of_a_template_is_the_first_of_the_sharpest() -> None:
    domain = load("T2")
    front = fr.template(domain, MeshingParameters(), 128)
    angles = mean_angles(domain.vertices, 2)
    assert slot_tree.least_slot(front.key) == np.flatnonzero(angles < angles.min() + 1e-9)[0]
