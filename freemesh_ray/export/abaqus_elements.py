"""Abaqus' and CalculiX' elements that can be chosen: what they are for, and how many nodes they have."""

from __future__ import annotations

#: By name, the nodes of an element: plane strain, plane stress, axisymmetric (around x = 0), shells, solids; R:
#: integrated at fewer points.
NODES: dict[str, int] = {
    "CPE4": 4, "CPE4R": 4, "CPE8": 8, "CPE8R": 8,
    "CPS4": 4, "CPS4R": 4, "CPS8": 8, "CPS8R": 8,
    "CAX4": 4, "CAX4R": 4, "CAX8": 8, "CAX8R": 8,
    "S4": 4, "S4R": 4, "S8": 8, "S8R": 8,
    "C3D8": 8, "C3D8R": 8, "C3D8I": 8, "C3D20": 20, "C3D20R": 20,
}  # fmt: skip

#: What is written unless something is chosen, by dimensions and nodes.
USUAL = {(2, 4): "CPE4", (2, 8): "CPE8", (3, 8): "C3D8", (3, 20): "C3D20"}


def dimension(name: str) -> int:
    """2 for elements of quadrilaterals, 3 for those of hexahedra."""
    return 3 if name.startswith("C3D") else 2
