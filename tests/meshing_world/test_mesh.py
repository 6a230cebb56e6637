"""What keeps a mesh from being one of its domain: each defect is named, and a sound mesh has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from quad_grids import grid, random_mesh

from envs.mesh import Mesh

SOUND = grid(3, 3)


def bent() -> Mesh:
    """One of its inner vertices lies beyond the opposite corner of an element."""
    vertices = SOUND.vertices.copy()
    vertices[5] += 0.5
    return replace(SOUND, vertices=vertices)


def flat() -> Mesh:
    """A corner of an element lies on the line between its neighbours."""
    vertices = SOUND.vertices.copy()
    vertices[5] = vertices[[1, 4]].mean(axis=0)
    return replace(SOUND, vertices=vertices)


@given(st.integers(0, 2**32 - 1))
def test_a_sound_mesh_has_no_defects(seed: int) -> None:
    mesh = random_mesh(seed)
    assert mesh.defects() == mesh.defects(area=mesh.areas.sum()) == []


@pytest.mark.parametrize(("mesh", "defects"), [
    (bent(), ["3 elements are not strictly convex"]),
    (flat(), ["1 elements are not strictly convex"]),
    (replace(SOUND, quads=SOUND.quads[:, ::-1]),
     ["9 elements are not strictly convex", "the elements cover -1 of an area of 1"]),
    (replace(SOUND, quads=SOUND.quads[[*range(9), 4]]),
     ["4 edges are shared by more than two elements", "the elements cover 1.11111111111 of an area of 1"]),
    (replace(SOUND, quads=np.delete(SOUND.quads, 4, axis=0)),
     ["4 boundary edges differ from the given segments", "the elements cover 0.888888888889 of an area of 1"]),
    (replace(SOUND, segments=SOUND.segments[1:]), ["1 boundary edges differ from the given segments"]),
    (replace(SOUND, quads=np.delete(SOUND.quads, 4, axis=0), complete=False), []),
], ids=["bent", "flat", "clockwise", "twice", "missing", "another boundary", "not complete"])  # fmt: skip
def test_every_defect_is_named(mesh: Mesh, defects: list[str]) -> None:
    assert mesh.defects(area=1.0) == defects
