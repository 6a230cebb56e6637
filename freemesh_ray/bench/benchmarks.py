"""The benchmarks: what each measures, and what it needs. None is imported before it runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from freemesh_ray.policies.policy import Policy


@dataclass(frozen=True)
class Benchmark:
    """One benchmark: a module of this package whose ``run`` measures and prints a table.

    Attributes:
        meaning: what is measured, in a line.
        module: its file in this package.
        takes: the keyword arguments of its ``run``: ``seconds`` of each measurement, ``policy``, or both.
        default: whether it runs when none is named.
        package: one beside this project's own that it cannot do without, by its import name; empty: none.
    """

    meaning: str
    module: str
    takes: tuple[str, ...] = ("seconds",)
    default: bool = False
    package: str = ""


#: All benchmarks by name, in the order in which they are listed.
BENCHMARKS = {
    "env": Benchmark("env steps a second, by the length of the front", "env_steps", default=True),
    "learner": Benchmark(
        "updates a second of training, beside Stable-Baselines3's", "learner", default=True, package="stable_baselines3"
    ),
    "sampling": Benchmark("transitions a second, by the number of env runners", "sampling", default=True),
    "mesher": Benchmark("elements a second, by the size of the mesh", "elements", takes=("policy",)),
    "serving": Benchmark(
        "meshes a second over HTTP, and what clients notice of a kill", "service_load", takes=("policy", "seconds")
    ),
    "gpu": Benchmark("updates a second by batch size, on the CPU and on CUDA", "gpu"),
}


def run(names: Sequence[str], *, seconds: float, policy: Policy) -> None:
    """Run benchmarks and print their tables; one whose package is missing is skipped, with a line that says so.

    Args:
        names: keys of `BENCHMARKS`; none: those that are run by default.
        seconds: of each measurement, above 0.
        policy: whose meshing is measured.
    """
    from freemesh_ray.formatting.terminal import say  # it takes along more than a list of names needs

    arguments = {"seconds": seconds, "policy": policy}
    for name in names or (name for name, one in BENCHMARKS.items() if one.default):
        benchmark = BENCHMARKS[name]
        if benchmark.package and find_spec(benchmark.package) is None:
            say(f"{name}: skipped: {benchmark.package} is not installed (pip install {benchmark.package})")
        else:
            measure = import_module(f"freemesh_ray.bench.{benchmark.module}").run
            measure(**{key: arguments[key] for key in benchmark.takes})
        say()
