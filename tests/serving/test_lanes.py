"""Which requests are quick ones: by the processor time that they are expected to take, and then by what they took."""

from __future__ import annotations

import asyncio
import json
import math
import signal
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import ray
from traced_memory import little_memory

import freemesh_ray
from envs.domains.load import load
from envs.polygons.element_count import expected_in_domain
from freemesh_ray.finish.refill import EFFORTS
from freemesh_ray.policies.policy import SHIPPED, Policy
from freemesh_ray.serving import overruns, pool
from freemesh_ray.serving.answer import Answer, MeshRequest, answer, looks_quick, region_of
from freemesh_ray.serving.expected_time import REFILLING, expected_seconds
from freemesh_ray.serving.lanes import COSTLY, QUICK
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.parameters import Parameters, parameters

#: Sharp corners, which leave irregular nodes to be refilled; area 36.
STAR = json.dumps(
    {"type": "Polygon", "coordinates": [[[0, 0], [4, 1], [8, 0], [7, 4], [8, 8], [4, 7], [0, 8], [1, 4]]]}
).encode()


@pytest.mark.parametrize(
    ("elements", "query", "quick"),
    [
        (100, {}, True),
        (1544, {}, False),  # 1.06 s on the machine of expected_time
        (1544, {"effort": "quick"}, True),
        (1544, {"clean": False}, True),
        (150, {"effort": "thorough"}, False),
        (100, {"best_of": 8}, False),
        (100, {"best_of": 8, "effort": "quick"}, True),
        (20_000, {"effort": "quick"}, False),
    ],
)
def test_the_lane_goes_by_the_time_that_is_expected(elements: int, query: dict[str, Any], quick: bool) -> None:
    policies = {"even": Policy.load(SHIPPED["even"])}
    wanted = Parameters("even", edge_length=(48.0 / elements) ** 0.5, **query)
    made = answer(MeshRequest(STAR, wanted), policies, Limits(), QUICK)
    assert (made is not None) == quick
    if made is not None:
        assert made.status == 200


def star(corners: int, inner: float) -> list[Any]:
    turns = np.arange(corners) * (2 * math.pi / corners)
    radii = np.where(np.arange(corners) % 2, inner, 1.0)
    return [np.stack([radii * np.cos(turns), radii * np.sin(turns)], axis=1).tolist()]


def plate(holes: int) -> list[Any]:
    """One in each unit square, with sides of 0.4."""
    size = math.ceil(math.sqrt(holes))
    corners = [(i % size + 0.3, i // size + 0.3) for i in range(holes)]
    squares = [[[x, y], [x, y + 0.4], [x + 0.4, y + 0.4], [x + 0.4, y]] for x, y in corners]
    return [[[0, 0], [size, 0], [size, size], [0, size]], *squares]


def disc(vertices: int) -> list[Any]:
    return star(vertices, 1.0)


@pytest.mark.parametrize(
    ("rings", "query", "quick"),
    [
        (star(500, 0.6), {"effort": "quick"}, False),  # 3.6 s
        (star(360, 0.5), {}, False),  # 1.4 s
        (star(360, 0.5), {"effort": "quick"}, False),  # 1.2 s
        (plate(10), {"effort": "quick"}, False),  # 1.2 s
        (plate(100), {"effort": "quick"}, False),  # 2.5 s
        (plate(400), {"effort": "quick"}, False),  # 5.4 s
        (plate(1), {}, True),
        (plate(2), {}, True),  # 0.04 s
        (plate(2), {"edge_length": 0.15}, True),
        (plate(25), {"effort": "quick", "edge_length": 0.15}, True),  # even: no side is long for what is around it
        (star(20, 0.5), {}, True),
        (star(120, 0.5), {}, True),  # 0.2 s
        (star(120, 0.5), {"best_of": 8, "effort": "quick"}, False),
        (disc(40), {}, True),
    ],
)
def test_sharp_corners_and_holes_are_expected_to_take_longer(rings: Any, query: dict[str, Any], quick: bool) -> None:
    """Seconds are those of the machine of expected_time."""
    body = json.dumps({"type": "Polygon", "coordinates": rings}).encode()
    request = MeshRequest(body, Parameters("even", **query))
    domain = region_of(replace(request, parameters=replace(request.parameters, fix_parity=True)), Limits()).domain
    assert looks_quick(request, domain, expected_in_domain(domain), Limits()) == quick


@pytest.mark.parametrize("name", ["T1", "T2", "T3"])
def test_the_catalogue_s_small_domains_are_quick(name: str) -> None:
    domain = load(name)
    request = MeshRequest(b"", Parameters("even"))
    assert looks_quick(request, domain, expected_in_domain(domain), Limits())


def test_a_doubtful_request_is_quick_only_where_it_is_small() -> None:
    policies = {"even": Policy.load(SHIPPED["even"])}
    for edge_length, quick in ((3.0, True), (0.7, False)):
        request = MeshRequest(STAR, Parameters("even", edge_length=edge_length, fix_parity=True))
        assert answer(request, policies, Limits(), QUICK) is not None
        assert (answer(replace(request, doubtful=True), policies, Limits(), QUICK) is not None) == quick


def test_who_sent_what_looked_quick_and_was_not_is_doubted_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    now, seen = 0.0, list[tuple[str, str, bool]]()
    monkeypatch.setattr(ray, "put", lambda value: value)
    monkeypatch.setattr(ray, "remote", lambda **_: lambda kind: kind)
    monkeypatch.setattr(overruns, "monotonic", lambda: now)

    class Actor:
        answer: Any

    async def answered(request: MeshRequest, lane: str) -> tuple[Answer | None, bool]:
        seen.append((request.client, lane, request.doubtful))
        if lane == QUICK and request.body == b"long":
            return None, not request.doubtful
        return (None, False) if lane == QUICK and request.body == b"large" else (Answer(200, b""), False)

    async def all_of_them() -> None:
        nonlocal now
        meshers, actor = pool.MesherPool({}, Limits(), 1), Actor()
        actor.answer = Actor()
        actor.answer.remote = answered
        for lane in (QUICK, COSTLY):
            meshers._queues[lane].give(pool._Running(actor))

        async def ask(body: bytes, client: str) -> list[tuple[str, str, bool]]:
            seen.clear()
            assert (await meshers.mesh(MeshRequest(body, Parameters("even"), client))).status == 200
            return list(seen)

        assert await ask(b"large", "a") == [("a", QUICK, False), ("a", COSTLY, False)]
        assert await ask(b"long", "a") == [("a", QUICK, False), ("a", COSTLY, True)]
        assert await ask(b"small", "a") == [("a", QUICK, True)]
        assert await ask(b"small", "b") == [("b", QUICK, False)]
        now = 20.0
        assert await ask(b"long", "b") == [("b", QUICK, False), ("b", COSTLY, True)]
        now = 29.9
        assert await ask(b"small", "a") == [("a", QUICK, True)]
        now = 30.1
        assert await ask(b"small", "a") == [("a", QUICK, False)]
        assert await ask(b"small", "b") == [("b", QUICK, True)]

    asyncio.run(all_of_them())


@pytest.mark.parametrize(("edge_length", "words"), [(0.0004, "at most 500,000"), (1e-9, "at most 10,000")])
def test_a_mesh_too_large_is_refused_before_its_boundary_is_split(edge_length: float, words: str) -> None:
    square = b'{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1]]]}'
    request = MeshRequest(square, Parameters("even", edge_length=edge_length))
    answer(request, {}, Limits(elements=1), COSTLY)
    with little_memory(100_000):
        made = answer(request, {}, Limits(), QUICK)
    assert made is not None
    assert (made.status, words in made.body.decode()) == (413, True)


def test_more_is_expected_to_take_longer() -> None:
    assert REFILLING.keys() == EFFORTS.keys()
    wanted = Parameters("even")
    times = [expected_seconds(n, replace(wanted, effort=effort)) for n in (10, 1000, 10**6) for effort in EFFORTS]
    assert times == sorted(times)
    assert times[0] < Limits().quick_expected < Limits().quick_seconds
    assert expected_seconds(100, replace(wanted, best_of=3)) > 2 * expected_seconds(100, wanted)
    assert expected_seconds(100, replace(wanted, best_of=3), 1.0) > 3.0 + expected_seconds(100, wanted)


def test_an_effort_is_a_parameter() -> None:
    found = parameters([("effort", "thorough")], ["even"], Limits())
    assert (found.effort, parameters([], ["even"], Limits()).effort) == ("thorough", "usual")


def test_efforts_make_the_meshes_that_python_makes() -> None:
    policies = {"even": Policy.load(SHIPPED["even"])}
    for effort in ("quick", "usual"):
        wanted = Parameters("even", edge_length=0.5, effort=effort)
        made = answer(MeshRequest(STAR, wanted), policies, Limits(), COSTLY)
        assert made is not None
        own = freemesh_ray.mesh(json.loads(STAR), edge_length=0.5, effort=effort)
        assert json.loads(made.body)["quads"] == own.quads.tolist()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("work", "ended"),
    [
        ("time.sleep(0.5); __import__('os')._exit(0)", 0),  # as where the machine is busy: it waits for a core
        ("while True: pass", "SIGPROF"),
    ],
)
def test_the_quick_lane_counts_processor_time(work: str, ended: int | str) -> None:
    code = f"import time\nfrom freemesh_ray.serving.worker import limit_time\nlimit_time(60.0, 0.1)\n{work}"
    done = subprocess.run([sys.executable, "-c", code], timeout=120)
    assert done.returncode == (-getattr(signal, ended) if isinstance(ended, str) else ended)
