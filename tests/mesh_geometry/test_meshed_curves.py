"""Meshes of discs, ellipses and rings as they are handed out, with their sides on the curves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from curved_meshes import area, jacobians

from envs.mesh import Mesh
from envs.polygons import curves
from envs.polygons.curved_edges import curved_edges, on_curves
from envs.polygons.drawing import Line
from envs.polygons.exact_curves import EllipseArc
from freemesh_ray import mesh as meshed
from freemesh_ray.mesh_geometry import lagrange
from freemesh_ray.mesh_geometry.high_order import high_order


def drawn(seed: int) -> tuple[Mesh, float]:
    """An ellipse or a ring of two, meshed; and its area."""
    rng = np.random.default_rng(seed)
    ratio, edge_length = rng.uniform(0.2, 1.0), rng.uniform(0.15, 0.5)
    arcs = [EllipseArc(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, ratio]))]
    if seed % 2:
        # Its half diameters are conjugate, not square to each other.
        arcs.append(
            EllipseArc(ratio * np.array([0.1, 0.05]), ratio * np.array([0.4, 0.1]), np.array([-0.1, 0.3]) * ratio)
        )
    fineness = curves.flattening(2.5, edge_length)
    lines = [Line(curves.sampled(arc.at, arc.bounds, fineness), curve=arc) for arc in arcs]
    rings = [line.points[:-1] for line in lines]
    found = meshed(shapely.Polygon(rings[0], rings[1:]), edge_length=edge_length)
    edges = curved_edges(found.vertices, found.segments, lines, rings)
    assert len(edges.edges) == len(found.segments)
    areas = [np.pi * abs(arc.major[0] * arc.minor[1] - arc.major[1] * arc.minor[0]) for arc in arcs]
    return replace(found, vertices=on_curves(found.vertices, edges), curved=edges), 2.0 * areas[0] - sum(areas)


@pytest.mark.parametrize("seed", range(6))
def test_no_element_is_turned_over_and_the_area_is_that_of_the_curves(seed: int) -> None:
    mesh, exact = drawn(seed)
    assert not mesh.defects()
    for order in (2, 3, 4):
        found = high_order(mesh, order)
        assert not len(found.spoiled)
        points = np.concatenate([lagrange.gauss(order + 1)[0], np.linspace(0.0, 1.0, 9)])
        assert jacobians(found, points)[2].min() >= 0.0
        assert abs(area(found) - exact) < 0.01 * abs(mesh.areas.sum() - exact)
