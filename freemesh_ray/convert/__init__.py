"""A mesh as the object of another library: meshio's, PyVista's, scikit-fem's."""

from freemesh_ray.convert.meshio_mesh import to_meshio
from freemesh_ray.convert.pyvista_grid import to_pyvista
from freemesh_ray.convert.skfem_mesh import to_skfem

__all__ = ["to_meshio", "to_pyvista", "to_skfem"]
