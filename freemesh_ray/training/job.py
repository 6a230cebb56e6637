"""The main job: train, evaluate, checkpoint, keep the best policy; then mesh every stage with it.

    claim -> build -> [ train -> evaluate every interval -> checkpoint every interval ] -> mesh, draw, export

The loop in brackets is `freemesh_ray.training.loop`.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from envs.domains.load import UserDomains, source
from envs.errors import PluginError
from envs.plug_ins.environment_parts import NONE
from envs.types import Domain, DomainError
from envs.wrappers.wrapped_env import wrapped
from freemesh_ray import plots
from freemesh_ray.config import ConfigError, dump, flatten, meshing_parameters, plug_ins, read_plain
from freemesh_ray.config import load as load_config
from freemesh_ray.policies.evaluation import MODES, metric, user_metric
from freemesh_ray.policies.policy import Policy
from freemesh_ray.storage.atomic import OutputError, refusing_links, replacing
from freemesh_ray.tracking import MLflowRun
from freemesh_ray.training import checkpoint
from freemesh_ray.training.callback import Callback, Callbacks, callbacks_named
from freemesh_ray.training.loop import Algorithm, Training
from freemesh_ray.training.run import Run
from freemesh_ray.training.run_folder import RunError, RunFolder, TrainingError
from freemesh_ray.training.stage_meshes import FINISHED, RAW, mesh_stage

#: What the meshes' metrics begin with.
METRICS = {RAW: "mesh", FINISHED: "finished"}

#: Errors of the input or the place, which going back to a checkpoint does not mend.
FINAL = (DomainError, ConfigError, RunError, OutputError, checkpoint.CheckpointError, PluginError)


def train(
    config: Mapping[str, Any],
    *,
    resume: bool = False,
    make: Callable[[Mapping[str, Any]], Algorithm],
    callbacks: Sequence[Callback] = (),
    interrupted: Callable[[], bool] = lambda: False,
) -> Run:
    """The whole main job; what fails on the way goes on from the last checkpoint.

    Args:
        config: a complete tree (``config.load``), its paths absolute (`config.paths`).
        resume: go on from the run's newest checkpoint; without one, begin.
        make: the algorithm's factory.
        callbacks: told of it, in order.
        interrupted: see Training.

    Raises:
        DomainError, RunError, InUseError: see `claimed`.
        ConfigError: a setting that cannot be had here, as a GPU.
        TrainingError: it failed more often in a row than ``checkpoint.retries``.
        CheckpointError: none of its checkpoints can be read.
        OutputError: something cannot be written.
        PluginError: a callback raised, or another plug-in failed; everything up to then is in a checkpoint.
    """
    told = Callbacks([*callbacks, *callbacks_named(config)])
    with claimed(config, resume) as folder:
        return _retried(config, folder, resume, make, told, interrupted)


def _retried(
    config: Mapping[str, Any],
    folder: RunFolder,
    resume: bool,
    make: Callable[[Mapping[str, Any]], Algorithm],
    callbacks: Callbacks,
    interrupted: Callable[[], bool],
) -> Run:
    """`train` in a folder that is this process's."""
    failures = 0
    while True:
        before = _newest(folder)
        try:
            return _attempt(config, folder, resume, failures, make, callbacks, interrupted)
        except FINAL as error:
            if isinstance(error, PluginError):
                _write_down(folder, error)
            raise
        except Exception as error:
            brief = (str(error) or type(error).__name__).strip().splitlines()[0][:200]
            _write_down(folder, error)
            now = _newest(folder)
            failures = 1 if now != before else failures + 1
            if failures > config["checkpoint"]["retries"]:
                raise TrainingError(
                    f"{folder.path}: {brief} ({folder.failures.name} has more): mend the cause, --resume goes on from "
                    f"{now or 'the start'}"
                ) from error
            callbacks.tell("on_note", f"{brief}; going back to {now or 'the start'} (failure {failures} in a row)")
            resume = True


def _newest(folder: RunFolder) -> str | None:
    """The name of the newest checkpoint, if there is one.

    Raises:
        RunError: the folder that was claimed is gone or cannot be reached, as a shared one may be.
    """
    try:
        folder.lock.stat()
        return next((path.name for path in checkpoint.found(folder.checkpoints)), None)
    except OSError as error:
        raise RunError(
            f"{folder.path}: is out of reach ({error.strerror}): mend it, --resume goes on from the last checkpoint"
        ) from error


def _attempt(
    config: Mapping[str, Any],
    folder: RunFolder,
    resume: bool,
    failures: int,
    make: Callable[[Mapping[str, Any]], Algorithm],
    callbacks: Callbacks,
    interrupted: Callable[[], bool],
) -> Run:
    """`train` until something fails; after failures with other random numbers, which may not bring them about again."""
    tracking = config["tracking"]
    with (
        started(make, config) as algorithm,
        MLflowRun(
            folder.path,
            uri=tracking["uri"],
            experiment=tracking["experiment"],
            name=config["name"],
            params=flatten(config),
            tags=tags(config),
            resume=resume,
            folders=[*config["paths"].values()],
            enabled=tracking["enabled"],
        ) as run,
    ):
        training = Training(algorithm, config, folder, run, callbacks, interrupted)
        if resume:
            training.resume()
        if failures:
            algorithm.reseed(failures)
        with replacing(folder.config) as draft:
            draft.write_text(dump(config), encoding="utf-8")
        run.artifact(folder.config)
        training.loop()
        return conclude(training)


@contextmanager
def started(make: Callable[[Mapping[str, Any]], Algorithm], config: Mapping[str, Any]) -> Iterator[Algorithm]:
    """An algorithm whose processes end here: RLlib would ask for a Ray again, were they ended after it is gone."""
    algorithm = make(config)
    try:
        yield algorithm
    finally:
        with suppress(Exception):  # of what has failed, not all may be there to be ended
            algorithm.stop()


def _write_down(folder: RunFolder, error: Exception) -> None:
    """Append the whole story of a failure to the run's log of failures, as far as the disk takes it."""
    story = f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC\n{''.join(traceback.format_exception(error))}\n"
    with suppress(OSError), open(folder.failures, "ab", opener=refusing_links) as file:
        file.write(story.encode("utf-8", "backslashreplace"))


def tags(config: Mapping[str, Any]) -> dict[str, str]:
    """What runs are told apart by in the tracking store."""
    return {
        "algorithm": config["algorithm"],
        "seed": str(config["seed"]),
        "domain": ",".join(config["curriculum"]["stages"]),
    }


#: What a run cannot change when it goes on: its experience and its networks are of these.
FIXED = (
    "algorithm", "env.", "learner.hidden", "learner.layer_norm", "learner.normalise_observations", "learner.n_step",
    "curriculum.stages",
)  # fmt: skip


def prepare(config: Mapping[str, Any], resume: bool) -> None:
    """Before anything is started: see what `claimed` would refuse.

    Raises:
        DomainError, RunError, InUseError: see `claimed`.
    """
    with claimed(config, resume):
        pass


@contextmanager
def claimed(config: Mapping[str, Any], resume: bool) -> Iterator[RunFolder]:
    """The run's folder, which is made; no other process trains in it meanwhile.

    Raises:
        DomainError: a stage that cannot be meshed or trained on, or two of one name.
        PluginError: a plug-in that cannot be had, or fails at once.
        RunError: the run has checkpoints and ``resume`` is false, it was begun with other settings, or its folder
            cannot be made.
        InUseError: another process trains in it.
    """
    check_stages(config)
    check_plug_ins(config)
    folder = RunFolder(Path(config["paths"]["runs"]) / config["name"])
    with folder.claimed(resume):
        if resume and checkpoint.found(folder.checkpoints) and folder.config.is_file():
            check_unchanged(folder, config)
        yield folder


def check_stages(config: Mapping[str, Any]) -> None:
    """Refuse stages that cannot be trained on.

    Raises:
        DomainError: as said.
    """
    domains = [source(stage) for stage in config["curriculum"]["stages"]]
    for domain in domains:
        if isinstance(domain, Domain) and len(domain.ring) < 6:
            raise DomainError(f"{domain.name}: {len(domain.ring)} vertices are one element: train on at least 6")
        if sum(other.name == domain.name for other in domains) > 1:
            raise DomainError(f"{domain.name}: curriculum.stages names it twice: the stages' names must differ")


def check_plug_ins(config: Mapping[str, Any]) -> None:
    """Refuse plug-ins that cannot be had, or fail at once: in the first step of an environment.

    Raises:
        PluginError: as said.
    """
    for spec in config["evaluation"]["metrics"]:
        user_metric(spec)
    callbacks_named(config)
    supplies = [source(stage) for stage in config["curriculum"]["stages"]]
    for supply in supplies:
        if isinstance(supply, UserDomains):
            supply.held_out(1)
    own = plug_ins(config)
    if own != NONE:
        parameters = meshing_parameters(config)
        env = wrapped(own.wrappers, domain=supplies[:1], parameters=parameters, reward=own.reward, observe=own.observe)
        env.reset(seed=0)
        env.step(np.zeros(parameters.action_size, dtype=np.float32))
        env.close()


def check_unchanged(folder: RunFolder, config: Mapping[str, Any]) -> None:
    """Refuse to go on with other `FIXED` settings than the run began with.

    Raises:
        RunError: one differs.
    """
    recorded, now = read_plain(folder.config), flatten(config)
    if isinstance(recorded, dict) and recorded.get("algorithm") != config["algorithm"]:
        before = recorded  # one that is a user's own is not imported for this
        now = {"algorithm": config["algorithm"]}
    else:
        before = flatten(load_config([folder.config]))
    for key, value in now.items():
        if key.startswith(FIXED) and before.get(key) != value:
            raise RunError(
                f"{folder.path} was begun with {key} = {before.get(key)}, not {value}: go on with the same, "
                "or --set name=OTHER to begin another"
            )


def conclude(training: Training) -> Run:
    """Mesh every stage of a training that came to its end with its best policy, and draw the learning curve.

    Files and the meshes' figures are tracked: ``mesh/DOMAIN/...`` of the raw ones, ``finished/DOMAIN/...`` of the
    finished ones.

    Raises:
        OutputError: a file cannot be written.
        KeyboardInterrupt: it was interrupted.
        PluginError: a callback raised.
    """
    folder = training.folder
    policy = replace(Policy.load(folder.policy, altered=True), plug_ins=plug_ins(training.config))
    stages = []
    for stage in training.config["curriculum"]["stages"]:
        training.leave_if_told()
        stages.append(mesh_stage(policy, stage, folder.meshes))
    for stage in stages:
        for name, prefix in METRICS.items():
            figures = stage.figures.get(name, {})
            values = {f"{prefix}/{stage.domain}/{key}": value for key, value in figures.items()}
            training.run.metrics(values, step=training.progress.env_steps)
    for path in [folder.policy, draw_curve(folder), *(file for stage in stages for file in stage.files)]:
        training.run.artifact(path, "meshes" if path.parent == folder.meshes else None)
    run = Run(folder, training.progress, stages)
    training.callbacks.tell("on_end", run)
    training.callbacks.check()
    return run


def draw_curve(folder: RunFolder) -> Path:
    """Draw the evaluation returns against env steps."""
    rows = folder.read_evaluations()
    series = {}
    for mode in MODES:
        key = metric(mode, "return")
        series[mode] = ([row["env_steps"] for row in rows], [row.get(key, math.nan) for row in rows])
    plots.draw_curves(
        series, folder.curve, xlabel="environment steps", ylabel="mean return of an evaluation episode",
        title="Evaluation return over all stages",
    )  # fmt: skip
    return folder.curve
