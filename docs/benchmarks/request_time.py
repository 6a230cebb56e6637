"""Processor time of requests to `freemesh serve`: measured, and as `serving/expected_time.py` expects it.

    .venv/bin/python docs/benchmarks/request_time.py [--elements 100 300 1000 5000] [--efforts quick usual]
        [--density even]

Four polygons are split by the edge length that gives about so many elements, meshed, and written as JSON, all in this
process. ``thorough`` takes up to 12 s for each.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path

from hostile_load import polygon
from script import run_script

from envs.domains.load import load
from envs.polygons.element_count import expected_in_domain
from freemesh_ray.formatting.table import table
from freemesh_ray.mesher import mesh_domain
from freemesh_ray.policies.policy import SHIPPED, Policy
from freemesh_ray.serving.answer import MeshRequest, answer, region_of
from freemesh_ray.serving.expected_time import REFILLING, expected_seconds
from freemesh_ray.serving.lanes import COSTLY
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.parameters import Parameters

#: Simple to fill, round, with sharp corners, and a part with holes; GeoJSON.
POLYGONS = {
    "rectangle": b'{"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3]]]}',
    "disc": polygon(40, 1.0),
    "star": b'{"type": "Polygon", "coordinates": [[[0, 0], [4, 1], [8, 0], [7, 4], [8, 8], [4, 7], [0, 8], [1, 4]]]}',
    "part": (Path(__file__).parents[1] / "examples/part.geojson").read_bytes(),
}


def main() -> None:
    """Measure, and print a line for each request."""
    parser = argparse.ArgumentParser(description="Processor time of requests.")
    parser.add_argument("--elements", type=int, nargs="+", default=[100, 300, 1000, 5000])
    parser.add_argument("--efforts", nargs="+", choices=list(REFILLING), default=["quick", "usual"])
    parser.add_argument("--density", choices=list(SHIPPED), default="even")
    options = parser.parse_args()
    policies, limits = {options.density: Policy.load(SHIPPED[options.density])}, Limits()
    mesh_domain(policies[options.density], load("D4"))
    rows = []
    for effort in options.efforts:
        for name, body in POLYGONS.items():
            whole = region_of(MeshRequest(body, Parameters(options.density, fix_parity=True)), limits)
            for elements in options.elements:
                edge_length = math.sqrt(whole.domain.area / elements)
                request = MeshRequest(body, Parameters(options.density, edge_length=edge_length, effort=effort))
                expected = expected_in_domain(region_of(request, limits).domain)
                began = time.process_time()
                made = answer(request, policies, limits, COSTLY)
                took = time.process_time() - began
                assert made is not None
                if made.status != 200:
                    rows.append((name, effort, str(elements), json.loads(made.body)["error"], "", ""))
                    continue
                seconds = expected_seconds(expected, request.parameters)
                rows.append((name, effort, str(elements), str(made.elements), f"{took:.2f}", f"{seconds:.2f}"))
    print(table(("polygon", "effort", "wanted", "elements", "s", "expected s"), rows, left=(0, 1)))


if __name__ == "__main__":
    run_script(main)
