"""Which requests are quick ones: by the processor time that they are expected to take, and then by what they took."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from dataclasses import replace
from typing import Any

import pytest
from traced_memory import little_memory

import freemesh_ray
from freemesh_ray.finish.refill import EFFORTS
from freemesh_ray.policies.policy import SHIPPED, Policy
from freemesh_ray.serving.answer import MeshRequest, answer
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
        ("time.sleep(0.5)", 0),  # as where the machine is busy: it waits for a core
        ("while True: pass", "SIGPROF"),
    ],
)
def test_the_quick_lane_counts_processor_time(work: str, ended: int | str) -> None:
    code = f"import time\nfrom freemesh_ray.serving.worker import limit_time\nlimit_time(60.0, 0.1)\n{work}"
    done = subprocess.run([sys.executable, "-c", code], timeout=120)
    assert done.returncode == (-getattr(signal, ended) if isinstance(ended, str) else ended)
