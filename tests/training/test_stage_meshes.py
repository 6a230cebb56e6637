"""Stages meshed with the best policy: only what the policy completes by itself counts as its mesh."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import meshio
import pytest

from envs.domains.load import load
from freemesh_ray.mesher import mesh_domain
from freemesh_ray.policies.policy import SHIPPED, Policy
from freemesh_ray.training import stage_meshes
from freemesh_ray.training.stage_meshes import FORMATS, mesh_stage


@pytest.fixture
def shipped() -> Policy:
    return Policy.load(SHIPPED["medium"])


@pytest.mark.slow
@pytest.mark.parametrize(("stage", "name"), [("T1", "T1"), ("random", "random-held-out-0"), ("part:7", "part-7")])
def test_both_meshes_fill_the_stage_and_are_written(stage: str, name: str, shipped: Policy, tmp_path: Path) -> None:
    made = mesh_stage(shipped, stage, tmp_path / "meshes")
    assert (made.domain, made.reason, list(made.meshes)) == (name, "", ["raw", "finished"])
    area = load(name).area
    for mesh in made.meshes.values():
        assert mesh.defects(area) == []
    assert made.figures["finished"]["eta"] > made.figures["raw"]["eta"]
    assert made.figures["finished"]["singularity"] <= made.figures["raw"]["singularity"]
    assert {path.name for path in made.files} == {path.name for path in (tmp_path / "meshes").iterdir()}
    assert made.files[0].name == f"{name}.png"
    for which, mesh in made.meshes.items():
        for suffix in FORMATS:
            assert tmp_path / "meshes" / f"{name}-{which}{suffix}" in made.files
        read = meshio.read(tmp_path / "meshes" / f"{name}-{which}.vtu")
        assert len(read.cells_dict["quad"]) == len(mesh.quads)


def test_a_mesh_that_had_to_be_filled_is_none_of_the_policy_s(
    shipped: Policy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = mesh_domain(shipped, load("T1"))
    assert made.filled == 0
    monkeypatch.setattr(stage_meshes, "mesh_domain", lambda *_: replace(made, sources={**made.sources, "filled": 12}))
    result = mesh_stage(shipped, "T1", tmp_path)
    assert result.reason == "the policy left a part that takes 12 elements to fill"
    assert (result.meshes, result.figures, result.files) == ({}, {}, ())
    assert list(tmp_path.iterdir()) == []
