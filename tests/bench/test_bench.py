"""The registry of benchmarks: each takes what the registry says, the command lists them, importing it is light."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from processes import ROOT, outside

from freemesh_ray.bench import benchmarks
from freemesh_ray.bench.benchmarks import BENCHMARKS
from freemesh_ray.cli import command

pytestmark = pytest.mark.slow

POLICY: Any = object()


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_takes_what_the_registry_says(name: str) -> None:
    run = import_module(f"freemesh_ray.bench.{BENCHMARKS[name].module}").run
    assert set(inspect.signature(run).parameters) == set(BENCHMARKS[name].takes)


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, dict[str, Any]]]:
    """The benchmarks that are run, by module, and what they are given; none measures anything."""
    calls: list[tuple[str, dict[str, Any]]] = []

    def imported(module: str) -> SimpleNamespace:
        return SimpleNamespace(run=lambda **given: calls.append((module.rpartition(".")[2], given)))

    monkeypatch.setattr(benchmarks, "import_module", imported)
    return calls


def test_each_is_given_what_it_takes(ran: list[tuple[str, dict[str, Any]]]) -> None:
    benchmarks.run(["serving", "env", "mesher"], seconds=3.0, policy=POLICY)
    assert ran == [
        ("service_load", {"policy": POLICY, "seconds": 3.0}),
        ("env_steps", {"seconds": 3.0}),
        ("elements", {"policy": POLICY}),
    ]


def test_without_a_name_the_default_ones_run(ran: list[tuple[str, dict[str, Any]]]) -> None:
    benchmarks.run([], seconds=1.0, policy=POLICY)
    assert [module for module, _ in ran] == ["env_steps", "learner", "sampling"]


def test_one_whose_package_is_missing_is_skipped(
    ran: list[tuple[str, dict[str, Any]]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(benchmarks, "find_spec", lambda name: None)
    benchmarks.run(["learner", "env"], seconds=1.0, policy=POLICY)
    assert [module for module, _ in ran] == ["env_steps"]
    assert "pip install stable_baselines3" in capsys.readouterr().out


def test_the_command_lists_them(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        command.main(["bench", "--help"])
    lines = capsys.readouterr().out.splitlines()
    for name, benchmark in BENCHMARKS.items():
        (line,) = [line for line in lines if line.split()[:1] == [name]]
        assert benchmark.meaning in line
        assert line.endswith("(default)") == benchmark.default


#: What makes each benchmark as small as it can be, in its module; and the words that its table begins with.
SMALLEST = {
    "env": ("FRONTS=(50, 100)", "front vertices"),
    "learner": ("WAYS={'float32': {}}, RUNS=1", "Stable-Baselines3"),
    "sampling": ("FRAGMENTS=(8, 16)", "env runners"),
    "mesher": ("DISCS=(50,), CROSSES=(100,)", "raw, elements/s"),
    "serving": ("DOMAINS=('part-3',), CLIENTS=(2,), REPLICAS=(1, 2)", "all replicas were back after"),
    "gpu": ("BATCHES=(256,), CALLS=(1,)", "updates a call"),
}
RUN = """
import sys
from importlib import import_module
from freemesh_ray.bench.benchmarks import BENCHMARKS
from freemesh_ray.cli.command import main
vars(import_module(f"freemesh_ray.bench.{{BENCHMARKS[{name!r}].module}}")).update(dict({smallest}))
sys.exit(main(["bench", "--part", {name!r}, "--seconds", "0.01"]))
"""


@pytest.mark.parametrize("name", BENCHMARKS)
def test_each_measures(name: str, tmp_path: Path) -> None:
    if BENCHMARKS[name].package:
        pytest.importorskip(BENCHMARKS[name].package)
    smallest, words = SMALLEST[name]
    done = subprocess.run(
        [sys.executable, "-c", RUN.format(name=name, smallest=smallest)], capture_output=True, text=True, timeout=3000,
        cwd=tmp_path, env=outside() | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert words in done.stdout
    assert re.search(r"\d", done.stdout)
    assert "nan" not in done.stdout


def test_importing_the_registry_is_light() -> None:
    heavy = ["numpy", "numba", "ray", "torch", "mlflow", "stable_baselines3"]
    code = f"import sys, freemesh_ray.bench.benchmarks; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout == "[]\n"
