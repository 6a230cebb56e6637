"""Other programs' numbering of nodes, by these programs."""

from __future__ import annotations

import numpy as np
import pytest

from freemesh_ray.mesh_geometry import node_order

ORDERS = (1, 2, 3, 4, 5)


@pytest.mark.parametrize("order", ORDERS)
def test_vtk_numbers_a_lagrange_quadrilateral_so(order: int) -> None:
    cell = pytest.importorskip("vtk").vtkLagrangeQuadrilateral()
    cell.SetOrder(order, order)
    cell.GetPointIds().SetNumberOfIds((order + 1) ** 2)
    cell.GetPoints().SetNumberOfPoints((order + 1) ** 2)
    cell.Initialize()
    told = np.array(cell.GetParametricCoords() and [
        [cell.PointIndexFromIJK(i, j, 0) for i in range(order + 1)] for j in range(order + 1)
    ]).ravel()  # fmt: skip
    np.testing.assert_array_equal(told[node_order.vtk(order)], np.arange((order + 1) ** 2))


@pytest.mark.parametrize("order", ORDERS)
def test_gmsh_numbers_a_quadrangle_so(order: int) -> None:
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        kind = gmsh.model.mesh.getElementType("Quadrangle", order)
        told = np.array(gmsh.model.mesh.getElementProperties(kind)[4]).reshape(-1, 2)
    finally:
        gmsh.finalize()
    x = np.linspace(-1.0, 1.0, order + 1)
    tensor = np.stack([np.tile(x, order + 1), np.repeat(x, order + 1)], axis=1)
    np.testing.assert_allclose(tensor[node_order.gmsh(order)], told, atol=1e-12)


def test_gmsh_numbers_order_two_and_three_as_its_manual_draws_them() -> None:
    assert node_order.gmsh(2).tolist() == [0, 2, 8, 6, 1, 5, 7, 3, 4]
    assert node_order.gmsh(3).tolist() == [0, 3, 15, 12, 1, 2, 7, 11, 14, 13, 8, 4, 5, 6, 10, 9]
