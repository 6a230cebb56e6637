"""Before the first mesh of a process: its kernels are compiled, or loaded, while no mesh's clock runs.

What is compiled is decided by a rehearsal: a small domain is meshed, finished and filled.
"""

from __future__ import annotations

import logging
import threading

import numpy as np

from envs.domains.load import from_rings
from envs.filling.chords import chord_point, inside
from envs.filling.convex_fill import best_filling
from envs.kernels.ahead_of_time import Tell, compiling, missing
from envs.kernels.inner import InnerKernel, Kernel
from envs.kernels.jit import kernels
from envs.mdp import transition
from envs.mesh import Mesh
from envs.quality import element_quality
from freemesh_ray.finish import finish
from freemesh_ray.mesher.engine import grow
from freemesh_ray.policies.policy import Policy

#: What compiling takes on a processor of 2020, in seconds of processor time.
SECONDS = 40

#: What whoever waits is told.
NOTICE = f"compiling the mesher's kernels, once: about {SECONDS} s"

_LOCK = threading.Lock()
_ready = False


def entries() -> list[Kernel]:
    """The kernels that Python calls for a mesh; not those that step environments or learn."""
    others = (transition.__name__, "freemesh_ray.algorithms.")
    return [k for k in kernels() if not isinstance(k, InnerKernel) and not k.__module__.startswith(others)]


def log(done: int, total: int) -> None:
    """Tell once, through ``logging``, as a warning: it takes longer than anybody expects."""
    if done == 0:
        logging.getLogger(__name__).warning(NOTICE)


def warm_up(policy: Policy, tell: Tell = log) -> None:
    """Make sure, once in a process, that no mesh waits for a kernel.

    Args:
        policy: any.
        tell: is called if there is something to compile, with the numbers of kernels compiled and to compile, from
            0 to all.
    """
    global _ready
    with _LOCK:
        if _ready or not kernels():
            return
        if missing(entries()):
            with compiling(entries(), tell):
                rehearse(policy)
                rehearse_filling()
        else:
            rehearse(policy)
        _ready = True


def octagon() -> Mesh:
    """Four elements around one vertex."""
    turn = 2.0 * np.pi * np.arange(8) / 8
    vertices = np.concatenate([np.stack([np.cos(turn), np.sin(turn)], axis=1), np.zeros((1, 2))])
    quads = np.array([[8, 7, 0, 1], [8, 1, 2, 3], [8, 3, 4, 5], [8, 5, 6, 7]])
    segments = np.stack([np.arange(8), (np.arange(8) + 1) % 8], axis=1)
    return Mesh("octagon", vertices, quads, segments, complete=True)


def rehearse(policy: Policy) -> None:
    """Call all that a mesh mostly needs."""
    mesh = octagon()
    grow(policy, from_rings(mesh.vertices[:8], name=mesh.name), 0)
    element_quality(mesh.vertices, mesh.quads)
    finish(mesh)


def rehearse_filling() -> None:
    """Call what fills the ring that is left now and then."""
    ring = octagon().vertices[:8].copy()
    best_filling(ring)
    chord_point(ring, 0, 2, 0)
    inside(ring)
