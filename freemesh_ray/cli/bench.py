"""``freemesh bench``: speeds on this machine."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from freemesh_ray.cli.arguments import add_command, add_policy, seconds

#: What is measured when nothing is named.
USUAL = ("env", "learner", "sampling")


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    bench = add_command(
        commands, "bench", "measure speeds on this machine", "Measure environment, learner and sampling speed."
    )
    bench.add_argument(
        "--part",
        action="append",
        choices=["env", "learner", "sampling", "mesher", "serving", "curves", "algorithms", "gpu", "scaling"],
        metavar="PART",
        help="env, learner, sampling (default: these three), mesher, serving, gpu (batch sizes on CPU and CUDA), "
        "scaling (env runners and learners, long), curves or algorithms (against Stable-Baselines3, long); repeatable",
    )
    add_policy(bench, more=", of the mesher")
    bench.add_argument("--seconds", type=seconds, default=5.0, help="of each measurement (5)")
    bench.add_argument("--out", default="bench", metavar="FOLDER", help="where curves and scaling are written")


def run(options: argparse.Namespace) -> int:
    """Measure, and print the tables.

    Raises:
        PolicyError: the policy file cannot be used.
    """
    from freemesh_ray import bench
    from freemesh_ray.policies.policy import DEFAULT, Policy

    policy = Policy.load(options.policy or DEFAULT)
    bench.run(options.part or USUAL, seconds=options.seconds, folder=Path(options.out), policy=policy)
    return 0
