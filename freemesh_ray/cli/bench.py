"""``freemesh bench``: speeds on this machine."""

from __future__ import annotations

import argparse
from typing import Any

from freemesh_ray.bench import benchmarks
from freemesh_ray.bench.benchmarks import BENCHMARKS
from freemesh_ray.cli.arguments import add_command, add_policy, seconds


def _listed() -> str:
    """Name and meaning of every benchmark, a line each."""
    width = max(map(len, BENCHMARKS))
    return "\n".join(
        f"  {name:{width}}  {one.meaning}{' (default)' if one.default else ''}" for name, one in BENCHMARKS.items()
    )


def _with(argument: str) -> str:
    """The benchmarks that take an argument, for its help."""
    return ", ".join(name for name, one in BENCHMARKS.items() if argument in one.takes)


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    bench = add_command(
        commands, "bench", "measure speeds on this machine", "Measure speeds on this machine.",
        f"benchmarks:\n{_listed()}",
    )  # fmt: skip
    bench.add_argument(
        "--part", action="append", choices=list(BENCHMARKS), metavar="BENCHMARK",
        help="what to measure, see below; repeatable (default: those marked)",
    )  # fmt: skip
    add_policy(bench, more=f"; for {_with('policy')}")
    bench.add_argument("--seconds", type=seconds, default=5.0, help=f"of each measurement (5); for {_with('seconds')}")


def run(options: argparse.Namespace) -> int:
    """Measure, and print the tables.

    Raises:
        PolicyError: the policy file cannot be used.
    """
    from freemesh_ray.policies.policy import DEFAULT, Policy

    policy = Policy.load(options.policy or DEFAULT)
    benchmarks.run(options.part or (), seconds=options.seconds, policy=policy)
    return 0
