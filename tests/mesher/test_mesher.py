"""The mesher: complete and valid meshes, the same ones again, whatever the policy; and its remedies one by one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from checkout import REFERENCES
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import from_rings, load
from envs.domains.random_domain import circle
from envs.filling.convex_fill import FillError
from envs.mdp import front as fr
from envs.mdp.action import ACCEPTED, TYPE_1, TYPE_2, decode_type
from envs.mdp.front import ELEMENTS, RING, Front, reference_slot
from envs.mdp.observation import observation_size
from envs.mdp.transition import numbers
from envs.mesh import Mesh
from envs.quality import element_quality
from envs.types import NO_WISHES, Domain, MeshingParameters, WantedSizes
from freemesh_ray.finish import USUAL
from freemesh_ray.mesher import MeshingError, domain_to_mesh, mesh_domain
from freemesh_ray.mesher.agent import agent
from freemesh_ray.mesher.backtracking import elements_back, mark
from freemesh_ray.mesher.candidates import candidates, consider
from freemesh_ray.mesher.domain_to_mesh import ATTEMPTS, mean_quality, mesh_once
from freemesh_ray.mesher.engine import Grown, grow
from freemesh_ray.mesher.ideal_elements import SHAPES, shape
from freemesh_ray.mesher.lookahead import DEPTH, fill, tree
from freemesh_ray.mesher.undo_log import SOURCES, element, undo_log
from freemesh_ray.policies.policy import DEFAULT, Policy, PolicyError


def constant(mean: tuple[float, float, float], log_std: float, **parameters: object) -> Policy:
    """Acts the same everywhere; ``mean`` before tanh."""
    bias = np.array([*mean, log_std, log_std, log_std], dtype=np.float32)
    return Policy([(np.zeros((15, 6), dtype=np.float32), bias)], MeshingParameters(**parameters))  # type: ignore[arg-type]


#: Asks for one new vertex half way out on the bisector, and draws widely around that.
BISECTOR = constant((0.0, 0.0, 0.0), 0.0)
#: Always asks for a new vertex on top of V_0, and draws nothing else: never valid.
STUCK = constant((0.0, -9.0, 0.0), -9.0)


def judged(policy: Policy) -> Policy:
    """The policy with random critics."""
    random = np.random.default_rng(0)
    critic = [(random.standard_normal((2, 18, 1)).astype(np.float32), np.zeros((2, 1), dtype=np.float32))]
    return replace(policy, critic=critic)


def assert_valid(grown: Grown, domain: Domain) -> None:
    """The mesh has no defect, keeps the boundary, and its figures add up; what is not meshed is the ring left."""
    made = grown.mesh
    assert made.defects(domain.area if made.complete else None) == []
    np.testing.assert_array_equal(made.vertices[: len(domain.points)], domain.points)
    assert sum(grown.sources.values()) == len(made.quads)
    assert sum(grown.action_types.values()) == len(made.quads) - int(made.complete)
    assert made.complete == (len(grown.ring) == 0)
    if not made.complete:
        x, y = made.vertices[grown.ring].T
        left = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
        assert left + made.areas.sum() == pytest.approx(domain.area, rel=1e-9)
    new = 2 * grown.action_types["type 2"] + grown.action_types["type 1"]
    assert len(made.vertices) == len(domain.points) + new


@pytest.mark.parametrize("policy", [BISECTOR, judged(BISECTOR), STUCK], ids=["bisector", "judged", "stuck"])
@pytest.mark.parametrize("name", ["T1", "T2", "D4", "D9", "random:3", "random:11", "random:20"])
def test_any_policy_yields_valid_elements(policy: Policy, name: str) -> None:
    domain = load(name)
    grown = grow(policy, domain, 0)
    assert_valid(grown, domain)
    assert len(grown.mesh.quads) > 0


@pytest.mark.parametrize("path", REFERENCES, ids=lambda path: path.stem)
def test_reference_domains(path: Path) -> None:
    domain = load(path)
    assert_valid(grow(BISECTOR, domain, 0), domain)


def test_a_policy_that_sees_nothing_completes_most_small_domains() -> None:
    complete = 0
    for seed in range(20):
        domain = load(f"random:{seed}?vertices=40&spikiness=0.2")
        grown = grow(BISECTOR, domain, seed, exploration=0.1)
        assert_valid(grown, domain)
        complete += grown.mesh.complete
    assert complete >= 15


@pytest.mark.parametrize("exploration", [0.0, 0.1])
def test_the_same_arguments_give_the_same_mesh(exploration: float) -> None:
    first, second = (grow(BISECTOR, load("T2"), (3, 1), exploration=exploration) for _ in range(2))
    assert first.mesh.vertices.tobytes() == second.mesh.vertices.tobytes()
    assert first.mesh.quads.tobytes() == second.mesh.quads.tobytes()
    assert (first.sources, first.backtracks, first.taken_back) == (second.sources, second.backtracks, second.taken_back)


def test_other_seeds_explore_other_ways() -> None:
    meshes = {grow(BISECTOR, load("T1"), seed, exploration=0.2).mesh.quads.tobytes() for seed in range(4)}
    assert len(meshes) == 4


def test_the_global_random_state_plays_no_part() -> None:
    np.random.seed(1)  # noqa: NPY002
    first = grow(STUCK, load("random:11"), 0)
    np.random.seed(2)  # noqa: NPY002
    assert grow(STUCK, load("random:11"), 0).mesh.quads.tobytes() == first.mesh.quads.tobytes()


@pytest.mark.parametrize("n", [100, 200, 400])
def test_a_smooth_boundary_is_begun(n: int) -> None:
    """No element of types 0 and 1 fits: every interior angle is above 0.98 pi."""
    domain = from_rings(circle(n), name="disc")
    grown = grow(constant((0.0, 0.0, 0.0), 0.0, max_elements=50), domain, 0)
    assert_valid(grown, domain)
    assert len(grown.mesh.quads) >= 50
    if n >= 250:
        assert grown.action_types["type 2"] > 0
        assert element_quality(grown.mesh.vertices, grown.mesh.quads[:1])[0] > 0.9


def test_figures_name_where_elements_come_from() -> None:
    grown = grow(STUCK, load("T1"), 0)
    assert tuple(grown.sources) == SOURCES
    assert grown.sources["policy"] == grown.sources["sampled"] == grown.sources["next vertex"] == 0
    assert grown.sources["wide"] > 0


def test_patience_bounds_the_backtracks() -> None:
    domain = load("T3")
    assert grow(STUCK, domain, 0, patience=0).backtracks == 0
    assert_valid(grow(STUCK, domain, 0, patience=0), domain)


def test_what_the_policy_leaves_is_filled() -> None:
    capped = constant((0.0, 0.0, 0.0), 0.0, max_elements=20)
    for name in ("T1", "T3", "D9"):
        domain = load(name)
        made = mesh_domain(capped, domain)
        assert made.filled > 0
        assert made.attempts == ATTEMPTS
        assert sum(made.sources.values()) == len(made.raw.quads)
        for mesh in (made.raw, made.finished):
            assert mesh.defects(area=domain.area) == []


def test_a_ring_without_room_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(points: object, ring: object) -> None:
        raise FillError("too thin")

    monkeypatch.setattr(domain_to_mesh, "fill", refuse)
    capped = constant((0.0, 0.0, 0.0), 0.0, max_elements=20)
    with pytest.raises(MeshingError, match="T1: too thin"):
        mesh_domain(capped, load("T1"))


def test_no_mesh_with_a_defect_is_handed_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def torn(grown: Grown, domain: Domain) -> Mesh:
        whole = completed(grown, domain)
        return replace(whole, quads=whole.quads[:-1])

    completed = domain_to_mesh.completed
    monkeypatch.setattr(domain_to_mesh, "completed", torn)
    with pytest.raises(MeshingError, match="T1: the mesh is not valid: "):
        mesh_domain(BISECTOR, load("T1"), smooth=False, clean=False)


def test_a_four_ring_is_its_own_mesh_or_filled() -> None:
    assert len(mesh_domain(STUCK, from_rings([(0, 0), (2, 0), (2, 1), (0, 1)])).raw.quads) == 1
    dart = from_rings([(0, 0), (2, 0), (0.2, 0.2), (0, 2)])
    assert mesh_domain(STUCK, dart).finished.defects(area=dart.area) == []


@pytest.mark.slow
def test_the_best_of_several_is_the_one_of_the_best_mean_quality() -> None:
    domain = load("T1")
    each = [mesh_once(BISECTOR, domain, (0, k), False, True, True, USUAL, NO_WISHES).finished for k in range(4)]
    qualities = [mean_quality(mesh) for mesh in each]
    best = mesh_domain(BISECTOR, domain, best_of=4).finished
    assert min(qualities) < max(qualities)
    assert best.quads.tobytes() == each[int(np.argmax(qualities))].quads.tobytes()


@pytest.mark.slow
def test_a_search_draws_where_a_plain_mesh_takes_the_mean_action() -> None:
    policy, domain = Policy.load(DEFAULT), load("T1")
    plain, searched, another = (
        mesh_domain(policy, domain, search=search, seed=seed) for search, seed in ((False, 0), (True, 0), (True, 1))
    )
    assert plain.attempts == searched.attempts == another.attempts == 1
    assert plain.raw.quads.tobytes() == mesh_domain(policy, domain, seed=1).raw.quads.tobytes()
    assert len({made.raw.quads.tobytes() for made in (plain, searched, another)}) == 3


def test_finishing_can_be_left_out() -> None:
    made = mesh_domain(BISECTOR, load("T1"), smooth=False, clean=False)
    assert made.finished is made.raw
    assert made.sequences == 0


# The attempts

DISC = from_rings(circle(24), name="disc")


def attempts_of(found: Sequence[Grown], asked: list[float]) -> Callable[..., Grown]:
    """An engine whose attempts come out as they are given; it notes how much each was asked to explore."""

    def grow(policy: Policy, domain: Domain, seed: tuple[int, ...], *, exploration: float, sizes: WantedSizes) -> Grown:
        asked.append(exploration)
        return found[len(asked) - 1]

    return grow


@pytest.fixture(scope="module")
def stopped() -> list[Grown]:
    """A disc begun as often as it is begun at most, and stopped after more and more elements."""
    policies = [constant((0.0, 0.0, 0.0), 0.0, max_elements=2 * (k + 1)) for k in range(ATTEMPTS)]
    return [grow(policy, DISC, 0) for policy in policies]


def test_a_domain_that_got_stuck_is_begun_again(monkeypatch: pytest.MonkeyPatch, stopped: list[Grown]) -> None:
    whole = replace(stopped[0], mesh=mesh_domain(BISECTOR, DISC).raw, ring=np.empty(0, dtype=np.int64))
    asked: list[float] = []
    monkeypatch.setattr(domain_to_mesh, "grow", attempts_of([stopped[0], whole], asked))
    made = mesh_domain(BISECTOR, DISC, smooth=False, clean=False)
    assert made.attempts == len(asked) == 2
    assert made.filled == 0
    assert made.raw.quads.tobytes() == whole.mesh.quads.tobytes()


def test_further_attempts_explore(monkeypatch: pytest.MonkeyPatch, stopped: list[Grown]) -> None:
    asked: list[float] = []
    monkeypatch.setattr(domain_to_mesh, "grow", attempts_of(stopped, asked))
    mesh_domain(BISECTOR, DISC, smooth=False, clean=False)
    first, *others = asked
    assert first == 0.0
    assert all(0.0 < share < 1.0 for share in others)


def test_the_attempt_that_covers_most_is_handed_out(monkeypatch: pytest.MonkeyPatch, stopped: list[Grown]) -> None:
    areas = [grown.mesh.areas.sum() for grown in stopped]
    assert len(set(areas)) == ATTEMPTS > 1
    best = stopped[int(np.argmax(areas))]
    for order in permutations(stopped):
        monkeypatch.setattr(domain_to_mesh, "grow", attempts_of(order, []))
        made = mesh_domain(BISECTOR, DISC, smooth=False, clean=False)
        assert made.raw.quads[: -made.filled].tobytes() == best.mesh.quads.tobytes()


# The size wanted


def sized(mean: tuple[float, float, float]) -> Policy:
    """Acts the same everywhere, in lengths of the size wanted."""
    bias = np.array([*mean, -9.0, -9.0, -9.0], dtype=np.float32)
    parameters = MeshingParameters(scale="size", density="local")
    return Policy([(np.zeros((observation_size(parameters), 6), dtype=np.float32), bias)], parameters)


@pytest.mark.slow
def test_a_policy_of_sizes_meshes_with_every_remedy() -> None:
    for name in ("T1", "random:3", "D9"):
        domain = load(name)
        made = mesh_domain(sized((0.0, 0.0, 0.0)), domain, seed=1)
        assert made.raw.defects(domain.area) == made.finished.defects(domain.area) == []
        again = mesh_domain(sized((0.0, 0.0, 0.0)), domain, seed=1)
        assert made.raw.vertices.tobytes() == again.raw.vertices.tobytes()


def test_limits_of_the_size_make_elements_larger_or_smaller() -> None:
    domain = from_rings(circle(60), name="disc")
    h = 2.0 * np.sin(np.pi / 60)
    counts = [
        len(
            mesh_domain(
                sized((0.0, 0.0, 0.0)), domain, sizes=WantedSizes(most=most), smooth=False, clean=False
            ).raw.quads
        )
        for most in (3.0 * h, h, 0.5 * h)
    ]
    assert counts[0] < counts[1] < counts[2]


def test_limits_for_a_policy_that_knows_no_size_are_refused_in_one_line() -> None:
    with pytest.raises(PolicyError, match=r"^T1: the policy was trained with env\.scale = front"):
        mesh_domain(BISECTOR, load("T1"), sizes=WantedSizes(most=1.0))


# The remedies


def begun(domain: Domain, policy: Policy) -> Front:
    """A fresh front with room for a few elements of all types."""
    start = fr.template(domain, policy.parameters, 128)
    return fr.with_room(start, 64, 32)


def test_shapes_are_square_where_the_front_is() -> None:
    """On a square grid's outline, the fourth corner and the upright edges make squares."""
    domain = from_rings(
        [(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (0, 3), (0, 2), (0, 1)]
    )
    front, mdp, action = begun(domain, BISECTOR), numbers(MeshingParameters()), np.empty(5)
    best = {TYPE_1: 0.0, TYPE_2: 0.0}
    for slot in range(12):
        for index in range(SHAPES):
            if not shape(front, slot, index, mdp, action):
                continue
            cut = element(front, slot, action, True, mdp)
            kind = decode_type(action[0], True)
            if cut.rejection == ACCEPTED and kind in best:
                corners = np.stack([cut.x, cut.y], axis=1)
                best[kind] = max(best[kind], element_quality(corners, np.arange(4)[None])[0])
    assert best[TYPE_1] == pytest.approx(1.0)
    assert best[TYPE_2] == pytest.approx(1.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_where_there_are_critics_they_choose(sign: float) -> None:
    """Critics that like new vertices far out, or near: of several draws that are valid the one they like is kept."""
    weights = np.zeros((2, 18, 1), dtype=np.float32)
    weights[:, 16] = sign
    policy = replace(BISECTOR, critic=[(weights, np.zeros((2, 1), dtype=np.float32))])
    front, mdp, judge, best = begun(load("T1"), policy), numbers(MeshingParameters()), agent(policy), candidates()
    slot = int(reference_slot(front))
    random, valid = np.random.default_rng(0), []
    for _ in range(50):
        best.draft[:3] = random.uniform(-1.0, 1.0, 3)
        if element(front, slot, best.draft, False, mdp).rejection == ACCEPTED:
            valid.append(sign * float(best.draft[1]))
        consider(best, front, slot, judge, True, False, mdp)
    assert len(set(valid)) > 1
    assert sign * best.action[1] == max(valid)


def test_a_search_asks_the_critics() -> None:
    domain = load("T1")
    plain, asked = (mesh_domain(policy, domain, search=True).raw for policy in (BISECTOR, judged(BISECTOR)))
    assert plain.quads.tobytes() != asked.quads.tobytes()


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([6, 8, 10]))
def test_lookahead_fills_small_rings_and_changes_nothing_where_it_cannot(seed: int, n: int) -> None:
    random = np.random.default_rng(seed)
    ring = circle(n) * random.uniform(0.4, 1.0, (n, 1))
    domain, mdp = from_rings(ring), numbers(MeshingParameters())
    front, log = begun(domain, BISECTOR), undo_log(32)
    before = Front(*(array.copy() for array in front))
    if fill(tree(), front, log, agent(BISECTOR), False, mdp):
        assert front.counts[RING] == 4
        assert 0 < front.counts[ELEMENTS] <= DEPTH
        assert log.area[0] == pytest.approx(domain.area)
    else:
        for one, other in zip(front, before, strict=True):
            assert one.tobytes() == other.tobytes()


def test_lookahead_finds_the_squares() -> None:
    """A ring of eight around two by two unit squares, a ring of ten around one by four: nothing beats the grid."""
    for outline, elements in (
        ([(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)], 4),
        ([(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (4, 1), (3, 1), (2, 1), (1, 1), (0, 1)], 4),
    ):
        made = mesh_domain(STUCK, from_rings(outline)).raw
        assert len(made.quads) == elements
        np.testing.assert_allclose(element_quality(made.vertices, made.quads), 1.0, atol=1e-9)


def test_a_detour_goes_back_to_the_elements_nearby() -> None:
    """Of a row of unit squares, those within reach of a place are counted from the last one."""
    domain = load("T1")
    front = begun(domain, BISECTOR)
    for i in range(6):
        front.points[2 * i : 2 * i + 2] = [(i, 0), (i, 1)]
        front.quads[i] = [2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1]
    place = np.array([0.5, 0.5, 1.0])
    assert [elements_back(front, 5, near, place) for near in (0, 1, 2, 3)] == [0, 4, 5, 5]
    slot = int(reference_slot(front))
    mark(front, slot, place)
    np.testing.assert_array_equal(place[:2], front.xy[slot])
