"""Kernels are compiled before a mesh's clock runs, once, by one process, and whoever waits is told."""

from __future__ import annotations

import io
import itertools
import json
import logging
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from checkout import ROOT
from numba.core.caching import FunctionCache

from envs.domains.load import load
from envs.kernels import jit as decorators
from envs.kernels import slot_tree
from envs.kernels.ahead_of_time import compiling, missing, needed
from envs.kernels.jit import compiled, inlined, inner
from envs.mdp.front import _index
from freemesh_ray.cli.kernel_progress import CompilingLine
from freemesh_ray.mesher import domain_to_mesh, mesh_domain, warm_up
from freemesh_ray.policies.policy import DEFAULT, Policy

#: ``freemesh mesh``, and then what was compiled: kernels by name with their signatures, and those a mesh may need.
FIRST = """
import json, sys
from numba.core.event import install_recorder
from freemesh_ray.cli.command import main
with install_recorder("numba:compile") as events:
    assert main(["mesh", "D4", "-o", sys.argv[1]]) == 0
from envs.kernels.jit import kernels
from envs.kernels.ahead_of_time import needed
from freemesh_ray.mesher.warm_up import entries
name = lambda kernel: f"{kernel.__module__}.{kernel.__name__}"
compiled = [name(e.data["dispatcher"]) for _, e in events.buffer if e.is_start]
known = {name(kernel) for kernel in kernels()}
print(json.dumps({
    "compiled": sorted(one for one in compiled if one in known),
    "signatures": {name(kernel): len(kernel.signatures) for kernel in kernels()},
    "needed": sorted(map(name, needed(entries()))),
}))
"""

#: Meshes of many kinds in a process that may load machine code, and has to compile none.
LATER = """
import json, sys
import numpy as np, shapely
from numba.core.event import install_recorder
import freemesh_ray
from envs.filling.convex_fill import fill
from envs.domains.load import load
from freemesh_ray.mesher import mesh_domain, domain_to_mesh
from freemesh_ray.policies.policy import SHIPPED, Policy
from hard_rings import drawn
with install_recorder("numba:compile") as events:
    for name in ("D1", "D4", "part:3", "random:5"):
        mesh_domain(Policy.load(SHIPPED["medium"]), load(name))
    mesh_domain(Policy.load(SHIPPED["dense"]), load("T1"), search=True, best_of=2)
    holed = shapely.box(0, 0, 3, 2).difference(shapely.Point(1, 1).buffer(0.5))
    freemesh_ray.mesh(holed, edge_length=0.2).quality()
    for seed in range(9):
        fill(*drawn(seed, 60))
    domain_to_mesh.ATTEMPTS = 0
    for name in ("D4", "T2"):
        filled = mesh_domain(Policy.load(SHIPPED["sparse"]), load(name))
        assert filled.filled == len(filled.raw.quads)
print(json.dumps([str(event.data["dispatcher"]) for _, event in events.buffer]))
"""


@dataclass(frozen=True)
class Done:
    """A process that has ended: what it printed, and the figures in its last line."""

    out: str
    err: str

    @property
    def figures(self) -> Any:
        return json.loads(self.out.splitlines()[-1])


def python(script: str, cache: Path, *arguments: str) -> subprocess.Popen[str]:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}
    return subprocess.Popen(
        [sys.executable, "-c", script, *arguments], env=environment, text=True, cwd=cache.parent,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def ended(process: subprocess.Popen[str]) -> Done:
    out, err = process.communicate(timeout=600)
    assert process.returncode == 0, out + err
    return Done(out, err)


@dataclass(frozen=True)
class Installed:
    """The first two meshes after an installation, begun at the same time, and where their machine code is."""

    cache: Path
    first: list[Done]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    folder = tmp_path_factory.mktemp("installed")
    cache = folder / "cache"
    processes = [python(FIRST, cache, str(folder / f"{i}.inp")) for i in range(2)]
    return Installed(cache, [ended(process) for process in processes])


@pytest.mark.slow
def test_of_two_processes_one_compiles_and_the_other_waits(installed: Installed) -> None:
    everything = [kernel for done in installed.first for kernel in done.figures["compiled"]]
    assert sorted(everything) == installed.first[0].figures["needed"]
    meshes = [(installed.cache.parent / f"{i}.inp").read_text() for i in range(2)]
    assert meshes[0] == meshes[1]


@pytest.mark.slow
def test_each_kernel_that_a_mesh_needs_has_one_signature(installed: Installed) -> None:
    [figures] = [done.figures for done in installed.first if done.figures["compiled"]]
    assert {name for name, count in figures["signatures"].items() if count} == set(figures["needed"])
    assert set(figures["signatures"].values()) == {0, 1}
    assert len(figures["needed"]) <= 260, "whoever adds kernels adds to the time before the first mesh"


@pytest.mark.slow
def test_the_first_mesh_says_what_it_waits_for(installed: Installed) -> None:
    [done] = [done for done in installed.first if done.figures["compiled"]]
    total = len(done.figures["needed"])
    notice, *lines = done.err.splitlines()
    assert notice == warm_up.NOTICE
    assert len(lines) == 4
    assert lines[-1] == f"compiling kernels: {total} of {total}"


@pytest.mark.slow
def test_the_next_mesh_says_nothing(installed: Installed) -> None:
    done = ended(python(FIRST, installed.cache, str(installed.cache.parent / "again.inp")))
    assert done.figures["compiled"] == []
    assert done.err == ""


@pytest.mark.slow
def test_no_mesh_waits_for_a_kernel_later(installed: Installed) -> None:
    done = ended(python(LATER, installed.cache))
    assert done.figures == []
    assert done.err == ""


def test_the_time_of_a_mesh_does_not_include_compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = itertools.count()
    passed = [0]

    def compile_for_an_hour(policy: Policy) -> None:
        passed[0] += 3600

    monkeypatch.setattr(domain_to_mesh, "time", SimpleNamespace(perf_counter=lambda: passed[0] + 1e-3 * next(clock)))
    monkeypatch.setattr(domain_to_mesh, "warm_up", compile_for_an_hour)
    for best_of in (1, 2):
        made = mesh_domain(Policy.load(DEFAULT), load("T1"), best_of=best_of)
        assert 0.0 < made.seconds_raw < made.seconds_finished < 60.0
    assert passed == [7200]


def test_programs_are_told_once_through_logging(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        for done in range(4):
            warm_up.log(done, 3)
    assert caplog.messages == [warm_up.NOTICE]


class Terminal(io.StringIO):
    """A stream that can be overwritten."""

    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_one_line() -> None:
    stream = Terminal()
    for done in range(53):
        CompilingLine(stream).show(done, 52)
    assert stream.getvalue() == "".join(f"\rcompiling kernels: {done} of 52" for done in range(53)) + "\n"


@pytest.mark.parametrize("total", [1, 3, 4, 52, 170])
def test_a_file_gets_few_lines(total: int) -> None:
    stream = io.StringIO()
    shown = CompilingLine(stream, "a notice")
    for done in range(total + 1):
        shown.show(done, total)
    notice, *lines = stream.getvalue().splitlines()
    assert notice == "a notice"
    assert 1 <= len(lines) <= 4
    assert lines[-1] == f"compiling kernels: {total} of {total}"


@inlined
def twice(x: float) -> float:
    return x + x


@inner
def four_times(x: float, again: bool) -> float:
    return twice(twice(x)) if again else twice(x)


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """A kernel for Python that calls both and has never been compiled."""
    monkeypatch.setattr(decorators, "cache_folder", lambda package: str(tmp_path))

    @compiled
    def eight_times(x: float) -> float:
        return four_times(x, True) + four_times(twice(x), False)

    return eight_times


def test_a_kernel_is_compiled_with_what_it_calls(kernel: Any) -> None:
    assert needed([kernel]) == {kernel, twice, four_times}
    assert slot_tree.build in needed([_index]), "a module's attribute"


def test_inner_kernels_are_the_same_for_kernels_and_for_python(kernel: Any) -> None:
    for x in (0.0, 1.5, -2.25):
        assert kernel(x) == 8 * x == 2 * four_times(x, True)
    assert len(four_times.signatures) == 1, "one for constants of any value"


def test_progress_is_told_from_nothing_to_all(kernel: Any) -> None:
    """Also when something else has compiled a part, another process say."""
    told: list[tuple[int, int]] = []
    with compiling([kernel], lambda *far: told.append(far)):
        kernel(1.0)
    assert told[0] == (0, 3)
    assert told[-1] == (3, 3)
    assert told == sorted(set(told))
    assert missing([kernel]) == []


def test_a_full_disk_keeps_nobody_from_meshing(kernel: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(FunctionCache, "save_overload", full)
    assert missing([kernel]) == [kernel]
    assert kernel(1.0) == 8.0
    assert missing([kernel]) == []


def test_without_a_place_for_machine_code_there_is_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(decorators, "cache_folder", lambda package: str(tmp_path / "file" / "kernels"))
    eight_times = compiled(lambda x: four_times(x, True) + four_times(x, True))
    assert missing([eight_times]) == [eight_times]
    assert eight_times(1.0) == 8.0


def test_what_a_learner_compiles_is_not_the_mesher_s() -> None:
    """A process that trains and meshes waits for no kernel of the learner's, which it may never call."""
    import freemesh_ray.algorithms.mlp_passes  # noqa: F401
    from envs.kernels.jit import kernels

    modules = {kernel.__module__ for kernel in warm_up.entries()}
    assert "freemesh_ray.algorithms.mlp_passes" in {kernel.__module__ for kernel in kernels()}
    assert not any(module.startswith("freemesh_ray.algorithms") for module in modules)
    assert any(module.startswith("freemesh_ray.finish") for module in modules)
