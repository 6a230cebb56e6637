"""A call in a process of its own, for meshers that now and then take their process down with them."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from envs.types import Domain
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError


def isolated(mesh: Callable[[Domain, str], MixedMesh], domain: Domain, name: str) -> MixedMesh:
    """``mesh(domain, name)``, or a failure when its process dies; the time measured is still that of the meshing.

    Raises:
        PeerError: as ``mesh`` does, or the process died.
    """
    # Ctrl-C is the parent's: the child just ends.
    with ProcessPoolExecutor(
        1, multiprocessing.get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_DFL)
    ) as pool:
        try:
            return pool.submit(mesh, domain, name).result()
        except BrokenProcessPool:
            raise PeerError("crashed") from None
