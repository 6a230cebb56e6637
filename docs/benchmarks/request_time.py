"""Processor time of requests to `freemesh serve`: measured, and as `serving/expected_time.py` expects it.

    .venv/bin/python docs/benchmarks/request_time.py [--elements 100 300 1000 5000] [--efforts quick usual]
        [--density even] [--corners 20 60 120 200 360 500] [--holes 1 2 4 6 10 25 100]

Four polygons are split by the edge length that gives about so many elements, meshed, and written as JSON, all in this
process; stars of so many corners and plates of so many square holes are meshed as they are. ``thorough`` takes up to
12 s for each.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path

import numpy as np
from hostile_load import polygon
from script import run_script

from envs.domains.load import load
from envs.polygons.element_count import expected_in_domain
from freemesh_ray.formatting.table import table
from freemesh_ray.mesher import mesh_domain
from freemesh_ray.policies.policy import SHIPPED, Policy
from freemesh_ray.serving.answer import MeshRequest, answer, region_of
from freemesh_ray.serving.expected_time import REFILLING, expected_seconds, stuck_seconds
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

#: Radii of every other corner of a star whose others have 1.
INNER = (0.5, 0.9)


def star(corners: int, inner: float) -> bytes:
    """A star as GeoJSON."""
    turns = np.arange(corners) * (2 * math.pi / corners)
    radii = np.where(np.arange(corners) % 2, inner, 1.0)
    ring = np.stack([radii * np.cos(turns), radii * np.sin(turns)], axis=1)
    return json.dumps({"type": "Polygon", "coordinates": [ring.tolist()]}).encode()


def plate(holes: int, side: float = 0.4) -> bytes:
    """A square with so many square holes in rows, one in each unit square."""
    size = math.ceil(math.sqrt(holes))
    rings: list[list[list[float]]] = [[[0, 0], [size, 0], [size, size], [0, size]]]
    for hole in range(holes):
        x, y = hole % size + 0.3, hole // size + 0.3
        rings.append([[x, y], [x, y + side], [x + side, y + side], [x + side, y]])
    return json.dumps({"type": "Polygon", "coordinates": rings}).encode()


def main() -> None:
    """Measure, and print a line for each request."""
    parser = argparse.ArgumentParser(description="Processor time of requests.")
    parser.add_argument("--elements", type=int, nargs="+", default=[100, 300, 1000, 5000])
    parser.add_argument("--efforts", nargs="+", choices=list(REFILLING), default=["quick", "usual"])
    parser.add_argument("--density", choices=list(SHIPPED), default="even")
    parser.add_argument("--corners", type=int, nargs="*", default=[20, 60, 120, 200, 360, 500])
    parser.add_argument("--holes", type=int, nargs="*", default=[1, 2, 4, 6, 10, 25, 100])
    options = parser.parse_args()
    policies, limits = {options.density: Policy.load(SHIPPED[options.density])}, Limits()
    mesh_domain(policies[options.density], load("D4"))
    asked: list[tuple[str, str, bytes, float | None]] = []
    for name, body in POLYGONS.items():
        whole = region_of(MeshRequest(body, Parameters(options.density, fix_parity=True)), limits)
        asked += [(name, str(each), body, math.sqrt(whole.domain.area / each)) for each in options.elements]
    asked += [(f"star, {r:g}", f"{n} corners", star(n, r), None) for r in INNER for n in options.corners]
    asked += [("plate", f"{n} holes", plate(n), None) for n in options.holes]
    rows = []
    for effort in options.efforts:
        for name, wanted, body, edge_length in asked:
            parameters = Parameters(options.density, edge_length=edge_length, effort=effort, fix_parity=True)
            request = MeshRequest(body, parameters)
            domain = region_of(request, limits).domain
            seconds = expected_seconds(expected_in_domain(domain), parameters, stuck_seconds(domain))
            began = time.process_time()
            made = answer(request, policies, limits, COSTLY)
            took = time.process_time() - began
            assert made is not None
            if made.status != 200:
                rows.append((name, effort, wanted, json.loads(made.body)["error"], "", ""))
                continue
            rows.append((name, effort, wanted, str(made.elements), f"{took:.2f}", f"{seconds:.2f}"))
    print(table(("polygon", "effort", "wanted", "elements", "s", "expected s"), rows, left=(0, 1)))


if __name__ == "__main__":
    run_script(main)
