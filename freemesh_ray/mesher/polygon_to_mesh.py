"""Polygons in, meshes out, for programs: ``freemesh_ray.mesh(polygon)``."""

from __future__ import annotations

import base64
import math
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from envs.domains.load import load_geometry, object_geometry, own_sizes, wanted_sizes
from envs.errors import UserError
from envs.mesh import Mesh as PlainMesh
from envs.polygons.axis import axis_of
from envs.polygons.geometry import Geometry, Region, Test, named_by, with_regions
from envs.polygons.layers_along import BoundaryLayers, with_layers_along
from envs.polygons.periodic import node_pairs
from envs.polygons.size_cells import Size
from envs.polygons.sizing import CURVATURE
from envs.quality import element_quality
from envs.readers.size_input import size_of
from envs.types import NO_WISHES, Domain, Floats, Ints, WantedSizes
from freemesh_ray import convert, export, plots
from freemesh_ray.mesh_geometry import swept
from freemesh_ray.mesh_geometry.assembly import Part, assembled
from freemesh_ray.mesh_geometry.layered import with_layers
from freemesh_ray.mesh_geometry.metrics import measure
from freemesh_ray.mesh_geometry.mirrored import mirrored
from freemesh_ray.mesh_geometry.swept import SweptMesh
from freemesh_ray.mesher import MeshResult, check_memory, mesh_domain
from freemesh_ray.plots import replay
from freemesh_ray.policies.policy import DEFAULT, DENSITY, SHIPPED, Policy
from freemesh_ray.storage.atomic import check_writable

if TYPE_CHECKING:
    import meshio
    from skfem import MeshQuad

#: What a mesh can be written as.
SUFFIXES = (*export.SUFFIXES, *plots.SUFFIXES, replay.SUFFIX)


@dataclass(frozen=True, repr=False)
class Mesh(PlainMesh):
    """An all-quad mesh, finished.

    Attributes:
        result: how it came about: the mesh as the policy left it, times, what recovery was needed; of boundary layers
            nothing.
        layered: (m,) bool, the quads of boundary layers; None: there are none.
        periodic: for each pair of periodic sides (k, 2) int64: the vertices along the first one, each with its image.

    ``name``, ``vertices`` (n, 2) float64, ``quads`` (m, 4) int64 counter-clockwise, ``segments`` (s, 2) int64: see
    envs.mesh.Mesh.
    """

    result: MeshResult
    layered: np.ndarray | None = None
    periodic: dict[tuple[str, str], Ints] = field(default_factory=dict)

    @classmethod
    def from_domain(cls, domain: Domain, policy: Policy | None = None, **options: Any) -> Self:
        """The mesh of a domain.

        Args:
            domain: see envs.domains.load.load.
            policy: the shipped one by default.
            options: ``seed``, ``best_of``, ``search``, ``smooth``, ``clean``, ``effort``, ``sizes``,
                ``allow_large``: see mesher.mesh_domain.

        Raises:
            DomainError: a mesh too large.
            MeshingError: a domain thinner than its coordinates are precise.
            ValueError: an option's value that there is none of.
        """
        result = mesh_domain(Policy.load(DEFAULT) if policy is None else policy, domain, **options)
        best = result.finished
        return cls(best.name, best.vertices, best.quads, best.segments, best.complete, result)

    @classmethod
    def from_geometry(
        cls,
        geometry: Geometry,
        policy: Policy | None = None,
        wishes: Callable[[Domain], WantedSizes] = lambda _: NO_WISHES,
        **options: Any,
    ) -> Self:
        """One conforming mesh of all regions, with their names and those of sides and interfaces.

        Args:
            geometry: see envs.domains.load.load_geometry.
            policy: the shipped one by default.
            wishes: for each region's domain what is wanted of sizes inside.
            options: as of `from_domain`.

        Raises:
            DomainError, MeshingError, ValueError: as of `from_domain`.
        """
        return cls.from_results(*meshed(geometry, policy, wishes, **options))

    @classmethod
    def from_results(cls, geometry: Geometry, results: Sequence[MeshResult]) -> Self:
        """One conforming mesh of the regions' meshes; see `meshed`."""
        whole = assembly(geometry, [result.finished for result in results])
        raw = assembly(geometry, [result.raw for result in results])
        layered = in_layers(geometry, results)
        if geometry.mirror is not None:
            whole, raw = mirrored(whole, geometry.mirror), mirrored(raw, geometry.mirror)
            layered = None if layered is None else np.tile(layered, 2)
        alone = len(results) == 1 and geometry.mirror is None and layered is None
        result = results[0] if alone else combined(results, raw, whole)
        pairs = {
            pair.names: node_pairs(whole.vertices, whole.segments, pair, geometry.name) for pair in geometry.periodic
        }
        return cls(
            whole.name, whole.vertices, whole.quads, whole.segments, whole.complete, result,
            layered=layered, periodic=pairs, groups=whole.groups, curved=whole.curved,
        )  # fmt: skip

    def quality(self, *, boundary_layers: bool = True) -> dict[str, float]:
        """The mesh in numbers, by name; docs/glossary.md explains them.

        Args:
            boundary_layers: whether quads of boundary layers, which are thin, count in eta.

        Returns:
            elements: their number.
            eta, eta_p5, eta_min: element quality, 0 to 1 (a square): mean, 5th percentile, least.
            singularity: irregular nodes, interior nodes with other than four edges; a number.
            singularity_least: the fewest of three and five edges if every boundary node has as many elements as its
                angle asks for; a mesh with other numbers there may have fewer.
            min_angle, max_angle: mean |least angle - 90| and |largest angle - 90|, degrees; 0 is best.
            scaled_jacobian: -1 to 1 (a rectangle); stretch: 0 to 1 (a square); taper: 0 (a parallelogram) and above.
            triangles, non_convex: numbers, always 0.
            And ``_authors``, ``_paper``: the same by other definitions (see ``mesh_geometry.metrics.measure``).
        """
        figures = measure(self)
        if not boundary_layers and self.layered is not None and not self.layered.all():
            eta = element_quality(self.vertices, self.quads[~self.layered])
            figures |= {"eta": float(eta.mean()), "eta_p5": float(np.percentile(eta, 5)), "eta_min": float(eta.min())}
        return figures

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Draw it, coloured by quality, into a ``.png`` or ``.svg``.

        Raises:
            OutputError: a folder that is missing, or a place that cannot be written to.
        """
        check_writable(Path(path))
        plots.draw_mesh(self, Path(path))

    def _repr_html_(self) -> str:
        """The picture and the figures in one line, as notebooks show a mesh."""
        figures = self.quality()
        text = (
            f"{self!r}, eta {figures['eta']:.3f} (least {figures['eta_min']:.3f}), {figures['singularity']:.0f} "
            f"irregular nodes (least {figures['singularity_least']:.0f})"
        )
        picture = base64.b64encode(plots.mesh_png(self)).decode()
        return (
            f'<figure><img src="data:image/png;base64,{picture}" alt="{escape(self.name)}" style="max-width: 100%">'
            f"<figcaption>{escape(text)}</figcaption></figure>"
        )

    def to_meshio(self) -> meshio.Mesh:
        """As meshio's mesh, with names; see convert.to_meshio."""
        return convert.to_meshio(self)

    def to_pyvista(self) -> Any:
        """As PyVista's blocks, with names; see convert.to_pyvista."""
        return convert.to_pyvista(self)

    def to_skfem(self) -> MeshQuad:
        """As scikit-fem's mesh, with names; see convert.to_skfem."""
        return convert.to_skfem(self)

    def extruded(self, height: float, layers: int = 1, ratio: float = 1.0, *, order: int = 1) -> SweptMesh:
        """The hexahedra between the mesh and itself at a height; see mesh_geometry.swept.extruded."""
        return swept.extruded(self, height, layers, ratio, order=order)

    def revolved(
        self, degrees: float = 360.0, layers: int = 24, axis: str | Sequence[Sequence[float]] = "y", *, order: int = 1
    ) -> SweptMesh:
        """The hexahedra that the mesh leaves behind when it turns around an axis; see mesh_geometry.swept.revolved."""
        return swept.revolved(self, degrees, layers, axis_of(axis, self.name), order=order)

    def write(
        self,
        path: str | os.PathLike[str],
        *,
        version: str = "4.1",
        quadratic: bool = False,
        order: int | None = None,
        element_type: str | None = None,
    ) -> tuple[str, ...]:
        """Write it in the format that the extension names, one of ``SUFFIXES``.

        Args:
            path: of a format of docs/formats.md, a picture, or ``.html``, a replay; its folder must be there.
            version: of a ``.msh``, 4.1 or 2.2.
            quadratic: of order 2, elements of eight nodes where the format has such.
            order: of the elements, 1 to 4; nodes of curved sides are on their curves.
            element_type: of an ``.inp``, as ``CPS4``.

        Returns:
            What was changed or left out, a line each: names that the format cannot hold, parts that it does not keep.

        Raises:
            OutputError: another extension, elements that the format does not hold, a folder that is missing, or a
                place that cannot be written to.
        """
        place = Path(path)
        if place.suffix.lower() in plots.SUFFIXES:
            self.plot(place)
        elif place.suffix.lower() == replay.SUFFIX:
            check_writable(place)
            replay.write(self.result.raw, place, None if self.result.finished is self.result.raw else self)
        else:
            return export.write(self, place, version, quadratic, order=order, element_type=element_type)
        return ()


def meshed(
    geometry: Geometry,
    policy: Policy | None = None,
    wishes: Callable[[Domain], WantedSizes] = lambda _: NO_WISHES,
    left_out: Callable[[str, UserError], None] | None = None,
    **options: Any,
) -> tuple[Geometry, list[MeshResult]]:
    """Mesh each region by itself.

    Args:
        geometry, policy, wishes, options: as of `Mesh.from_geometry`.
        left_out: leave regions out that cannot be meshed, and call this with each: its domain's name, and why.

    Returns:
        The geometry of the regions that have a mesh, and these meshes.

    Raises:
        DomainError, MeshingError, ValueError: as of `Mesh.from_domain`, without ``left_out``.
    """
    policy = Policy.load(DEFAULT) if policy is None else policy
    regions, results = list[Region](), list[MeshResult]()
    for region in geometry.regions:
        try:
            results.append(mesh_domain(policy, region.domain, sizes=wishes(region.domain), **options))
        except UserError as error:
            if left_out is None:
                raise
            left_out(region.domain.name, error)
        else:
            regions.append(region)
    return replace(geometry, regions=tuple(regions)), results


def assembly(geometry: Geometry, meshes: Sequence[PlainMesh]) -> PlainMesh:
    """The regions' meshes as one, with their names."""
    parts = [
        Part(mesh, region.name, region.sides, region.curved)
        for mesh, region in zip(map(whole_region, geometry.regions, meshes), geometry.regions, strict=True)
    ]
    return assembled(parts, geometry.name, geometry.inside, geometry.places)


def whole_region(region: Region, mesh: PlainMesh) -> PlainMesh:
    """The mesh of a region's domain, and the boundary layers around it if there are any."""
    return mesh if region.layers is None else with_layers(region.layers, mesh)


def in_layers(geometry: Geometry, results: Sequence[MeshResult]) -> np.ndarray | None:
    """Which quads of the regions' meshes, one after the other, are of boundary layers; None: there are no layers."""
    if all(region.layers is None for region in geometry.regions):
        return None
    counts: list[int] = []
    for region, result in zip(geometry.regions, results, strict=True):
        counts += [0 if region.layers is None else len(region.layers.quads), len(result.finished.quads)]
    return np.repeat(np.tile([True, False], len(results)), counts)


def combined(results: Sequence[MeshResult], raw: PlainMesh, finished: PlainMesh) -> MeshResult:
    """What came about for several regions, as one."""
    sources: Counter[str] = Counter()
    for result in results:
        sources.update(result.sources)
    return MeshResult(
        raw,
        finished,
        seconds_raw=sum(result.seconds_raw for result in results),
        seconds_finished=sum(result.seconds_finished for result in results),
        attempts=max(result.attempts for result in results),
        sources=sources,
        backtracks=sum(result.backtracks for result in results),
        sequences=sum(result.sequences for result in results),
        patches=sum(result.patches for result in results),
        deviation=max(result.deviation for result in results),
    )


def mesh(
    polygon: Any,
    *,
    edge_length: float | None = None,
    grading: float = 1.0,
    curvature: float = CURVATURE,
    min_size: float = 0.0,
    max_size: float = math.inf,
    size: Size | Floats | str | os.PathLike[str] | None = None,
    fix_parity: bool = False,
    name: str | None = None,
    density: str = DENSITY,
    policy: Policy | None = None,
    allow_large: bool = False,
    layers: Sequence[str] = (),
    join: float | None = None,
    names: Mapping[str, Test] | None = None,
    regions: Sequence[str] | None = None,
    mirror: str | Sequence[Sequence[float]] | None = None,
    boundary_layers: BoundaryLayers | None = None,
    periodic: Sequence[tuple[str, str]] = (),
    **options: Any,
) -> Mesh:
    """Mesh a polygon, or several that share boundary, as one conforming mesh.

    Args:
        polygon: a file's path, a shapely Polygon, an (n, 2) array, a `Drawing` with names, or what else
            ``domains.load.load_geometry`` and ``object_geometry`` take. Its vertices are the boundary's unless
            ``edge_length`` is given. Several polygons are regions.
        edge_length: split the boundary into pieces of about this length, in the polygon's units; corners stay.
        grading: largest over smallest piece; 1: all alike but for arcs.
        curvature: where the boundary is split: pieces for a full turn of an arc, 4 to 180.
        min_size, max_size: bounds of the edge length wanted inside, in the polygon's units, for a policy whose scale is
            ``size``; by default those of the boundary.
        size: the edge length wanted at every place, of the boundary, which is split, and, for such a policy, inside;
            where ``edge_length`` is less, that. A function of (m, 2) places to (m,) edge lengths, an expression in x
            and y, (m, 3) rows x, y and an edge length, or a file: ``.csv`` rows, a ``.pos`` view or ``.msh`` node data
            of Gmsh. Elements are no larger, and grow from there no faster than ``env.size_gradient`` says. By default,
            and without ``edge_length``, the sizes at the points of a ``.geo`` that states any.
        fix_parity: split the longest segment when the number of boundary vertices is odd (with ``edge_length`` it
            never is).
        name: what messages and files call it; by default the file's name, or ``polygon``.
        density: ``sparse``, ``medium``, ``dense`` or ``even``: how large elements grow inside; ``even``: as the
            boundary's segments.
        policy: the shipped one of that density by default.
        allow_large: make a mesh of more than 2 million elements, too.
        layers: of a drawing's file, those that are read; by default all that are seen.
        join: ends of a drawing's curves within this distance meet, in its units; by default what rounding explains.
        names: of sides: functions of (m, 2) places to (m,) bool; a boundary segment whose ends and middle all pass has
            the name, before what the file says.
        regions: a name for each polygon, before what the file says.
        mirror: an axis of symmetry, ``x``, ``y`` or two points: one half is meshed, the other is its mirror image.
        boundary_layers: rows of thin quads along named sides; `Mesh.layered` tells which they are.
        periodic: pairs of names of sides, one the other shifted or turned, that get the same points; `Mesh.periodic`
            tells which vertices belong together. Names are those of the drawing, or those offered.
        options: ``seed``, ``best_of``, ``search``, ``smooth``, ``clean``, ``effort``: see mesher.mesh_domain.

    Returns:
        The mesh; its ``groups`` hold the names of sides, regions, interfaces and lines.

    Raises:
        DomainError: no polygon, one that cannot be meshed, or a mesh too large; one line with the place and the fix.
        UserError: sizes that are none; PolicyError: sizes for a policy that knows none.
    """
    said = size_of(size) if isinstance(size, str | os.PathLike) else size
    own = None
    if said is None and edge_length is None and isinstance(polygon, str | os.PathLike):
        own = own_sizes(polygon)
    split: dict[str, Any] = {
        "fix_parity": fix_parity, "edge_length": edge_length, "grading": grading, "curvature": curvature,
        "size": own if said is None else said, "allow_large": allow_large, "mirror": mirror,
        "periodic": periodic, "room": check_memory,
    }  # fmt: skip
    if isinstance(polygon, str | os.PathLike):
        geometry = load_geometry(polygon, layers=tuple(layers), join=join, **split)
    else:
        geometry = object_geometry(polygon, name or "polygon", **split)
    if name is not None:
        geometry = replace(geometry, name=name)
    if regions is not None:
        geometry = with_regions(geometry, regions)
    if names:
        geometry = named_by(geometry, names)
    if boundary_layers is not None:
        geometry = with_layers_along(geometry, boundary_layers)
    if policy is None:
        if density not in SHIPPED:
            raise ValueError(f"density = {density!r}: use one of {', '.join(SHIPPED)}")
        policy = Policy.load(SHIPPED[density])
    if said is None and policy.parameters.sized:
        said = own

    def wishes(domain: Domain) -> WantedSizes:
        return wanted_sizes(domain, said, edge_length=edge_length, least=min_size, most=max_size)

    return Mesh.from_geometry(geometry, policy, wishes, allow_large=allow_large, **options)
