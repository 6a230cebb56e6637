"""What is written of what can be chosen: how many nodes an element has."""

from __future__ import annotations

from pathlib import Path

from envs.types import Floats
from freemesh_ray.export import abaqus_elements
from freemesh_ray.export.element_kinds import ORDERS
from freemesh_ray.export.formats import FORMATS, Format
from freemesh_ray.storage.atomic import OutputError


def nodes_of_quadrilaterals(path: Path, order: int | None, quadratic: bool, element_type: str | None) -> int:
    """How many nodes a quadrilateral gets.

    Args:
        path: of the file, of a known format.
        order: 1 to 4; None: 1, 2 if ``quadratic``, or that of the element type.
        quadratic: order 2, with 8 nodes if the format has such elements.
        element_type: one of `abaqus_elements.NODES`, or None.

    Raises:
        OutputError: what the format does not hold, or choices that contradict each other.
    """
    suffix = path.suffix.lower()
    format = FORMATS[suffix]
    if quadratic and order not in (None, 2):
        raise OutputError(f"{path}: quadratic elements are of order 2, not {order}: say one of the two")
    wanted = 2 if quadratic else order
    if element_type is not None:
        nodes = _nodes_of_type(path, format, element_type, 2)
        if wanted not in (None, ORDERS[nodes]):
            fix = "leave out the order, or choose another"
            raise OutputError(f"{path}: {element_type} is of order {ORDERS[nodes]}, not {wanted}: {fix}")
        return nodes
    wanted = 1 if wanted is None else wanted
    fitting = [nodes for nodes in format.nodes if ORDERS[nodes] == wanted]
    if not fitting:
        others = ", ".join(s for s, f in FORMATS.items() if any(ORDERS[n] == wanted for n in f.nodes))
        orders = sorted({ORDERS[nodes] for nodes in format.nodes})
        what = "order 1" if orders == [1] else f"orders {', '.join(map(str, orders))}"
        fix = f"write {others}" if others else f"use one of {what.split(' ', 1)[1]}"
        raise OutputError(f"{path}: {suffix} holds elements of {what}, not of order {wanted}: {fix}")
    return 8 if quadratic and 8 in fitting else max(fitting)


def check_hexahedra(path: Path, nodes: int, order: int | None, quadratic: bool, element_type: str | None) -> None:
    """Refuse hexahedra of a number of nodes that the format does not hold, or that are not what is asked for.

    Raises:
        OutputError: they are such.
    """
    suffix = path.suffix.lower()
    format, own = FORMATS[suffix], 1 if nodes == 8 else 2
    if nodes not in format.hexes:
        others = ", ".join(other for other, each in FORMATS.items() if nodes in each.hexes)
        raise OutputError(f"{path}: {suffix} holds no hexahedra of {nodes} nodes: write {others}")
    wanted = 2 if quadratic else order
    if wanted not in (None, own):
        raise OutputError(f"{path}: its hexahedra are of order {own}, not {wanted}: sweep the mesh with that order")
    if element_type is not None:
        needed = _nodes_of_type(path, format, element_type, 3)
        if needed != nodes:
            fix = "choose another, or sweep with the other order"
            raise OutputError(f"{path}: {element_type} has {needed} nodes, and the hexahedra {nodes}: {fix}")


def check_axis(path: Path, places: Floats, element_type: str | None) -> None:
    """Refuse axisymmetric elements with nodes, (n, 2), left of their axis, x = 0.

    Raises:
        OutputError: they have some.
    """
    if element_type is not None and element_type.startswith("CAX") and places[:, 0].min() < 0.0:
        x, y = places[places[:, 0].argmin()].tolist()
        raise OutputError(f"{path}: {element_type} turns around x = 0, and a node is at ({x!r}, {y!r}): move the part")


def _nodes_of_type(path: Path, format: Format, element_type: str, dimension: int) -> int:
    if not format.element_types:
        raise OutputError(f"{path}: {path.suffix.lower()} has no element types to choose: leave {element_type} out")
    of_dimension = [name for name in format.element_types if abaqus_elements.dimension(name) == dimension]
    if element_type not in of_dimension:
        raise OutputError(f"{path}: unknown element type {element_type}: use one of {', '.join(of_dimension)}")
    return abaqus_elements.NODES[element_type]
