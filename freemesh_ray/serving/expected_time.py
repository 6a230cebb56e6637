"""Processor time that a request takes, told from what it asks for before any of it is meshed.

The numbers are rounded from 148 requests (a rectangle, a wavy disc, a star and docs/examples/part.geojson; 30 to 20,000
elements) on one core of an AMD EPYC; ``.venv/bin/python docs/benchmarks/request_time.py`` measures them again. They are
those of the costliest shape: a rectangle, which can be filled in rows, takes a tenth of the time.

Elements alone do not tell how long growing them takes. Where a segment is long for what lies around it, as between the
corners of a spiky star or beside many holes, a policy gets stuck, takes elements back and begins anew, up to a limit.
That part is fitted to stars of 20 to 500 vertices and to plates of 1 to 400 square holes, measured by the same program
while other programs had the machine's cores, too. It errs towards costly, and may be several times too much.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from envs.types import Domain
from freemesh_ray.serving.parameters import Parameters


class Refilling(NamedTuple):
    """Seconds that an effort puts into patches that are filled anew.

    Attributes:
        each: for each element.
        most: however many elements there are, since what is looked at has a limit of its own.
    """

    each: float
    most: float


#: Seconds for reading, checking and writing a polygon; and for each element to grow, to be moved and to be written.
FIXED: Final = 0.01
EACH: Final = 5e-5

#: By effort, see finish.refill.EFFORTS.
REFILLING: Final = {
    "quick": Refilling(0.0, 0.0),
    "usual": Refilling(1.2e-3, 1.3),
    "thorough": Refilling(4e-3, 12.0),
}

#: Vertices that a vertex has within the longer one of its segments where they are even, itself included.
EVEN: Final = 4.0

#: Seconds for each further such pair of vertices; and for each segment of a seam to a hole, all of it where vertices
#: have at least twice as many as even ones, less below.
PAIR, SEAM = 2e-4, 0.1


def expected_seconds(elements: float, wanted: Parameters, stuck: float = 0.0) -> float:
    """Processor seconds of a request, roughly.

    Args:
        elements: that each of its meshes is expected to have, see envs.polygons.element_count.
        wanted: its parameters, of which ``best_of``, ``effort`` and ``clean`` count.
        stuck: seconds beside, for each mesh, see `stuck_seconds`.
    """
    refilling = REFILLING[wanted.effort if wanted.clean else "quick"]
    return FIXED + wanted.best_of * (EACH * elements + min(refilling.each * elements, refilling.most) + stuck)


def stuck_seconds(domain: Domain) -> float:
    """Processor seconds that growing a mesh takes longer than its elements tell: corners are sharp, or holes close.

    It takes 0.1 s itself where each of 10,000 vertices is close to all others, and a millisecond for a few hundred.
    """
    from scipy.spatial import cKDTree  # a quarter of a second that the server itself need not wait

    vertices = domain.vertices
    lengths = np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1)
    reach = np.maximum(lengths, np.roll(lengths, 1))
    close = float(cKDTree(vertices).query_ball_point(vertices, reach, return_length=True).sum())
    seams = 0.5 * (len(vertices) - len(domain.segments))
    uneven = min(max(close / (EVEN * len(vertices)) - 1.0, 0.0), 1.0)
    return PAIR * max(close - EVEN * len(vertices), 0.0) + SEAM * seams * uneven
