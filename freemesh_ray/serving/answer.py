"""From a request to its answer: what a worker process does."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

import numpy as np

from envs.polygons.drawing import Drawing
from envs.polygons.element_count import expected_in_domain
from envs.polygons.geometry import Region
from envs.polygons.rings import as_ring
from envs.polygons.validation import geometry_of
from envs.readers.python_objects import polygons_of
from envs.types import Domain, DomainError
from freemesh_ray.mesh_geometry.assembly import Part, assembled
from freemesh_ray.mesher import MeshingError, mesh_domain
from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.expected_time import expected_seconds, stuck_seconds
from freemesh_ray.serving.formats import JSON, MEDIA_TYPES, encoded
from freemesh_ray.serving.lanes import QUICK
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.parameters import Parameters
from freemesh_ray.storage.atomic import OutputError

#: What messages and files call the polygon.
NAME = "polygon"

#: Characters kept of a message's beginning and end: some quote what was given.
HEAD, TAIL = 300, 100

#: Share of the time expected of a quick request that one may take whose client's requests took longer than expected.
DOUBTFUL = 0.1


@dataclass(frozen=True)
class MeshRequest:
    """What to mesh, and how.

    Attributes:
        body: the polygon's text as the client sent it, unchecked.
        client: the address that it came from, see connections.client_address; empty: not known.
        doubtful: whether it is a quick one only if it is expected to take a tenth of what others may: a request of its
            client looked quick of late, and was not.
    """

    body: bytes
    parameters: Parameters
    client: str = ""
    doubtful: bool = False


@dataclass(frozen=True)
class Answer:
    """What a client gets.

    Attributes:
        status: of HTTP.
        body: the mesh, or ``{"error": line}``.
        media_type: of the body.
        elements: of the mesh; 0 when there is none.
    """

    status: int
    body: bytes
    media_type: str = MEDIA_TYPES[JSON]
    elements: int = 0


class Refused(Exception):
    """A request that is not meshed; the status and the line that says why."""

    def __init__(self, status: int, line: str) -> None:
        super().__init__(line)
        self.status = status


def refusal(status: int, line: str) -> Answer:
    """The answer with an error's line."""
    short = line if len(line) <= HEAD + TAIL else f"{line[:HEAD]} ... {line[-TAIL:]}"
    return Answer(status, json.dumps({"error": short}).encode("ascii") + b"\n")


def answer(request: MeshRequest, policies: Mapping[str, Policy], limits: Limits, lane: str) -> Answer | None:
    """Mesh what is asked for, or say why not.

    Args:
        request: unchecked but for its parameters.
        policies: by density.
        limits: of which the numbers of vertices and elements are checked here; who calls limits the time.
        lane: of `lanes.LANES`.

    Returns:
        None for a request that is too costly for the quick lane.
    """
    began = time.perf_counter()
    wanted = request.parameters
    try:
        region = region_of(request, limits)
        domain = region.domain
        expected = expected_in_domain(domain)
        check_elements(expected, limits)
        if lane == QUICK and not looks_quick(request, domain, expected, limits):
            return None
        made = mesh_domain(
            policies[wanted.density], domain, seed=wanted.seed, best_of=wanted.best_of, smooth=wanted.smooth,
            clean=wanted.clean, effort=wanted.effort, allow_large=True,
        )  # fmt: skip
        mesh = assembled([Part(made.finished, region.name, region.sides, region.curved)], NAME)
        body = encoded(mesh, wanted.format, time.perf_counter() - began)
    except Refused as refused:
        return refusal(refused.status, str(refused))
    except (DomainError, MeshingError, OutputError) as error:
        return refusal(HTTPStatus.UNPROCESSABLE_ENTITY, in_parameters(str(error)))
    return Answer(HTTPStatus.OK, body, MEDIA_TYPES[wanted.format], len(mesh.quads))


def looks_quick(request: MeshRequest, domain: Domain, elements: float, limits: Limits) -> bool:
    """Whether a request is expected to take as little processor time as a quick one may.

    Args:
        request: of which the parameters count, and whether it is doubtful.
        domain: what it is to mesh.
        elements: that are expected of it.
        limits: of a request.
    """
    most = limits.quick_expected * (DOUBTFUL if request.doubtful else 1.0)
    if expected_seconds(elements, request.parameters) > most:
        return False
    return expected_seconds(elements, request.parameters, stuck_seconds(domain)) <= most


def region_of(request: MeshRequest, limits: Limits) -> Region:
    """The one polygon in a request's body, its boundary split, with the names of its sides.

    Raises:
        Refused: no JSON object, or too many vertices or elements.
        DomainError: no polygon, several, or one that cannot be meshed.
    """
    wanted = request.parameters
    polygons = polygons_of(parsed(request.body), NAME)
    if len(polygons) != 1:
        raise DomainError(f"{NAME}: {len(polygons)} polygons where one is needed; send them one by one")
    check_vertices(least_vertices(polygons[0], wanted.edge_length), limits)
    (region,) = geometry_of(
        Drawing(polygons), NAME, NAME, fix_parity=wanted.fix_parity, edge_length=wanted.edge_length,
        grading=wanted.grading, allow_large=True, room=lambda expected, _: check_elements(expected, limits),
    ).regions  # fmt: skip
    check_vertices(len(region.domain.ring), limits)
    return region


def least_vertices(rings: Sequence[Any], edge_length: float | None) -> int:
    """How many vertices a boundary has at least, before anything costly is done with it.

    Args:
        rings: of one polygon, unchecked.
        edge_length: by which its sides will be split, if they will.

    Raises:
        DomainError: coordinates that are none.
    """
    checked = [as_ring(ring, NAME, i) for i, ring in enumerate(rings)]
    given = sum(map(len, checked))
    if edge_length is None:
        return given
    perimeter = sum(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum() for ring in checked)
    # A side of x edge lengths gets round(x) pieces and at least one, hence 2/3 x or more.
    return max(given, int(min(perimeter / edge_length / 1.5, 1e18)))


def check_vertices(count: int, limits: Limits) -> None:
    """Refuse a boundary of too many vertices.

    Raises:
        Refused: there are more than the limit.
    """
    if count > limits.vertices:
        raise Refused(
            HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
            f"{NAME}: {count:,} boundary vertices or more, at most {limits.vertices:,} are meshed here; simplify it or "
            "use a larger edge_length",
        )


def check_elements(expected: float, limits: Limits) -> None:
    """Refuse a mesh that would be too large.

    Raises:
        Refused: it is expected to have more elements than the limit.
    """
    if expected > limits.elements:
        raise Refused(
            HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
            f"{NAME}: a mesh of about {expected:,.0f} elements, at most {limits.elements:,} are made here; use a "
            "larger edge_length",
        )


def parsed(body: bytes) -> dict[str, Any]:
    """The JSON object in a text.

    Raises:
        Refused: there is none.
    """
    try:
        # Whole numbers as floats: others could have millions of digits.
        value = json.loads(body, parse_int=float, parse_constant=not_a_number)
    except RecursionError:
        raise Refused(HTTPStatus.BAD_REQUEST, "body: JSON nested too deep; send a GeoJSON Polygon") from None
    except ValueError as error:
        raise Refused(HTTPStatus.BAD_REQUEST, f"body: not JSON ({error}); send a GeoJSON Polygon") from None
    if not isinstance(value, dict):
        raise Refused(HTTPStatus.BAD_REQUEST, "body: JSON, but no object; send a GeoJSON Polygon")
    return value


def not_a_number(word: str) -> float:
    """Refuse NaN and infinities, which JSON does not have."""
    raise ValueError(f"{word} is no number")


def in_parameters(line: str) -> str:
    """A line that advises options of the command, with the names of a request's parameters instead."""
    line = re.sub(r" \((\w+=\w*, )*\w+=\w* in Python\)", "", line).replace("--fix-parity", "fix_parity=true")
    return re.sub(r"--(\w+)-(\w+)", r"\1_\2", line)
