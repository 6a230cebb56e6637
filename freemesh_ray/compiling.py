"""``freemesh compile``: all kernels, now rather than when they are first needed; and how compiling is shown."""

from __future__ import annotations

import sys
import time
from typing import TextIO

import numpy as np

from envs.domain import load
from envs.episodes import Episodes
from envs.kernels.compiled import kernels
from envs.kernels.compiling import compiling, missing
from envs.kernels.inner import InnerKernel
from envs.types import MeshingParameters
from freemesh_ray.mesher.warm_up import rehearse, rehearse_filling
from freemesh_ray.policy import DEFAULT, Policy

#: Where a line cannot be overwritten, there is one for each such part.
PARTS = 4


class Shown:
    """How far compiling is: one line that is overwritten on a terminal, a few lines elsewhere.

    Args:
        stream: where to.
        notice: a line before the first, if any.
    """

    def __init__(self, stream: TextIO, notice: str = "") -> None:
        self._stream, self._notice, self._part = stream, notice, 0

    def show(self, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` kernels are compiled."""
        if done == 0 and self._notice:
            self._stream.write(self._notice + "\n")
        line = f"compiling kernels: {done} of {total}"
        if self._stream.isatty():
            self._stream.write("\r" + line + ("\n" if done == total else ""))
        elif done * PARTS >= total * (self._part + 1):
            self._part = done * PARTS // total
            self._stream.write(line + "\n")
        self._stream.flush()


def run() -> int:
    """``freemesh compile``."""
    began = time.process_time()
    wanted = missing(kernel for kernel in kernels() if not isinstance(kernel, InnerKernel))
    if not wanted:
        print("all kernels are compiled")
        return 0
    with compiling(wanted, Shown(sys.stdout).show):
        rehearse(Policy.load(DEFAULT))
        rehearse_filling()
        rehearse_training()
    print(f"all kernels are compiled, in {time.process_time() - began:.0f} s of processor time")
    return 0


def rehearse_training() -> None:
    """Call what an environment calls."""
    parameters = MeshingParameters()
    episodes = Episodes([load("T1")], parameters, 1)
    episodes.start(0, 0)
    episodes.step(np.zeros((1, parameters.action_size)))
