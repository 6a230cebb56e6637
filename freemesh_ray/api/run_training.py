"""A training from Python: ``freemesh_ray.train({"name": "mine", "curriculum.stages": ["T1"]})``."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from freemesh_ray.config import ConfigError, Overlay, load
from freemesh_ray.config.env_runner_count import runner_count
from freemesh_ray.config.paths import Paths
from freemesh_ray.local_ray import Session, environment, local_ray

if TYPE_CHECKING:
    from freemesh_ray.training.callback import Callback
    from freemesh_ray.training.loop import Algorithm
    from freemesh_ray.training.run import Run


def train(
    settings: Overlay | Sequence[Overlay] = (), *, callbacks: Sequence[Callback] = (), resume: bool = False
) -> Run:
    """Train a policy, keep the best one, and mesh every training domain with it, as ``freemesh train`` does.

    Ctrl-C saves a checkpoint. A Ray that is up is used, and stays; else one is started, and ended. Nothing is printed:
    see `freemesh_ray.ProgressLine`.

    Args:
        settings: over the defaults: a mapping, nested or by dotted key, a YAML file, or several of them.
        callbacks: told what happens, in this order.
        resume: go on from the run's newest checkpoint; without one, begin.

    Raises:
        ConfigError, DomainError, RunError, InUseError, CheckpointError: what is wrong with the input.
        PluginError: a callback raised; a checkpoint was saved.
        TrainingError: it failed again and again.
        KeyboardInterrupt: Ctrl-C; ``resume`` goes on.
    """
    several = [settings] if isinstance(settings, str | os.PathLike | Mapping) else settings
    for each in several if isinstance(several, Sequence) else [several]:
        if not isinstance(each, str | os.PathLike | Mapping):
            raise ConfigError(f"settings: {each!r}: give a mapping, a YAML file, or a list of these")
    environment()
    over = threading.Event()

    def interrupt(session: Session) -> None:
        if not over.is_set():
            os.kill(os.getpid(), signal.SIGINT)

    try:
        return run(Paths.from_environment().resolved(load(settings)), callbacks, resume, interrupt)
    finally:
        over.set()


def run(
    config: Mapping[str, Any], callbacks: Sequence[Callback], resume: bool, last_resort: Callable[[Session], None]
) -> Run:
    """`train` with a complete tree.

    Args:
        config: the tree, its paths absolute.
        callbacks, resume: see `train`.
        last_resort: called, from another thread, when the training does not obey a signal for some seconds.
    """
    from freemesh_ray.algorithms.device import check
    from freemesh_ray.training import job
    from freemesh_ray.training.stop_signal import StopSignal

    check(config["learner"])
    job.prepare(config, resume)
    processes = runner_count(config) + config["learner"]["count"]
    with local_ray(processes, "--resume goes on from the last checkpoint") as session:
        from freemesh_ray.algorithms.build import build

        def make(config: Mapping[str, Any]) -> Algorithm:
            algorithm = build(config)
            algorithm.hurried = stop.is_urgent
            return algorithm

        with StopSignal(lambda: last_resort(session)) as stop:
            return job.train(config, resume=resume, make=make, callbacks=callbacks, interrupted=stop.was_given)
