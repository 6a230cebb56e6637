"""``freemesh compile``: all kernels now, rather than when they are first needed."""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

from freemesh_ray.cli.arguments import add_command
from freemesh_ray.cli.kernel_progress import CompilingLine
from freemesh_ray.formatting.terminal import say


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    add_command(
        commands,
        "compile",
        "compile all kernels now",
        "Compile what meshing and training call, once, in about half a minute. `make install` does it; otherwise the\n"
        "first mesh and the first training do.",
    )


def run(options: argparse.Namespace) -> int:
    """Compile what is not compiled yet."""
    import envs.vector_env  # noqa: F401  its kernels are counted, too
    from envs.kernels.ahead_of_time import compiling, missing
    from envs.kernels.inner import InnerKernel
    from envs.kernels.jit import kernels
    from freemesh_ray.mesher.warm_up import rehearse, rehearse_filling
    from freemesh_ray.policies.policy import DEFAULT, Policy

    began = time.process_time()
    wanted = missing(kernel for kernel in kernels() if not isinstance(kernel, InnerKernel))
    if not wanted:
        say("all kernels are compiled")
        return 0
    with compiling(wanted, CompilingLine(sys.stdout).show):
        rehearse(Policy.load(DEFAULT))
        rehearse_filling()
        rehearse_training()
    say(f"all kernels are compiled, in {time.process_time() - began:.0f} s of processor time")
    return 0


def rehearse_training() -> None:
    """Call what an environment calls."""
    import gymnasium as gym

    envs = gym.make_vec("FreeMesh-v0", num_envs=1, vectorization_mode="vector_entry_point", domain="T1")
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
