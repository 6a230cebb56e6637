"""Processor time that a request takes, told from what it asks for before any of it is meshed.

The numbers are rounded from 148 requests (a rectangle, a wavy disc, a star and docs/examples/part.geojson; 30 to 20,000
elements) on one core of an AMD EPYC; ``python docs/benchmarks/request_time.py`` measures them again. They are those of
the costliest shape: a rectangle, which can be filled in rows, takes a tenth of the time.
"""

from __future__ import annotations

from typing import Final, NamedTuple

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


def expected_seconds(elements: float, wanted: Parameters) -> float:
    """Processor seconds of a request, roughly.

    Args:
        elements: that each of its meshes is expected to have, see envs.polygons.element_count.
        wanted: its parameters, of which ``best_of``, ``effort`` and ``clean`` count.
    """
    refilling = REFILLING[wanted.effort if wanted.clean else "quick"]
    return FIXED + wanted.best_of * (EACH * elements + min(refilling.each * elements, refilling.most))
