"""Which inputs go together, and which were meshed before."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from freemesh_ray.batch.inputs import jobs_of, meshed_before
from freemesh_ray.storage.atomic import OutputError


@pytest.mark.parametrize(
    ("sources", "split"),
    [
        (["a/part.dxf", "b/part.dxf"], False),
        (["part.dxf", "part.svg"], False),
        (["part.dxf", "PART.svg"], False),
        (["part.dxf", "x.dxf", "part-0.dxf"], True),
        (["part-0.dxf", "part.dxf"], True),
    ],
)
def test_two_of_one_name_are_refused_with_both(sources: list[str], split: bool) -> None:
    with pytest.raises(OutputError) as told:
        jobs_of(sources, split=split)
    assert all(source in str(told.value) for source in sources if source != "x.dxf")


def test_others_are_not() -> None:
    assert [job.stem for job in jobs_of(["a/part.dxf", "b/part-0.dxf", "D4"], split=False)] == ["part", "part-0", "D4"]


@pytest.mark.parametrize("split", [False, True])
def test_meshed_before_is_what_is_newer_in_every_format(tmp_path: Path, split: bool) -> None:
    source = tmp_path / "part.dxf"
    source.touch()
    os.utime(source, (1000, 1000))
    (job,) = jobs_of([str(source)], split=split)
    name = "part-3" if split else "part"
    assert not meshed_before(job, tmp_path, [".msh"], split=split)
    (tmp_path / f"{name}.msh").touch()
    assert meshed_before(job, tmp_path, [".msh"], split=split)
    assert not meshed_before(job, tmp_path, [".msh", ".png"], split=split)
    os.utime(tmp_path / f"{name}.msh", (999, 999))
    assert not meshed_before(job, tmp_path, [".msh"], split=split)
