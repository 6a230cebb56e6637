"""The main job: train, evaluate, checkpoint, keep the best policy; then mesh every stage with it.

    build -> [ train -> evaluate every interval -> checkpoint every interval ] -> mesh, draw, export

The loop in brackets is `freemesh_ray.training.loop`.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from envs.domains.load import source
from envs.mesh import Mesh
from envs.types import Domain, DomainError
from freemesh_ray import export, plots
from freemesh_ray.config import ConfigError, dump, flatten
from freemesh_ray.config import load as load_config
from freemesh_ray.mesher import MeshingError, make
from freemesh_ray.meshes.metrics import measure
from freemesh_ray.policies.evaluation import MODES, metric
from freemesh_ray.policies.policy import Policy
from freemesh_ray.storage.atomic import OutputError, replacing
from freemesh_ray.tracking import MLflowRun
from freemesh_ray.training import checkpoint
from freemesh_ray.training.loop import Algorithm, Progress, Status, Training
from freemesh_ray.training.run_folder import RunError, RunFolder, TrainingError


@dataclass(frozen=True)
class Produced:
    """One stage meshed with the best policy.

    Attributes:
        domain: its name.
        mesh: None where the policy did not complete it.
        figures: metrics of the mesh (metrics.measure); empty without one.
        files: written, picture first.
        reason: why there is no mesh.
    """

    domain: str
    mesh: Mesh | None
    figures: dict[str, float]
    files: list[Path]
    reason: str = ""


def produce(policy: Policy, domain: Domain, folder: Path) -> Produced:
    """Mesh a domain and write its picture and its .vtu, .msh and .inp into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        made = make(policy, domain, smooth=False, clean=False)
    except MeshingError as error:
        return Produced(domain.name, None, {}, [], str(error))
    if made.filled:
        return Produced(domain.name, None, {}, [], f"the policy left a part that takes {made.filled} elements to fill")
    files = [folder / f"{domain.name}{suffix}" for suffix in (".png", ".vtu", ".msh", ".inp")]
    plots.draw_mesh(made.raw, files[0])
    for path in files[1:]:
        export.write(made.raw, path)
    return Produced(domain.name, made.raw, measure(made.raw), files)


@dataclass(frozen=True)
class Trained:
    """What the main job leaves.

    Attributes:
        progress: at the end.
        policy: file of the best policy.
        checkpoint: newest checkpoint.
        curve: picture of the learning curve.
        produced: one entry a stage.
    """

    progress: Progress
    policy: Path
    checkpoint: Path
    curve: Path
    produced: list[Produced]


#: Errors of the input or the place, which going back to a checkpoint does not mend.
FINAL = (DomainError, ConfigError, RunError, OutputError, checkpoint.CheckpointError)


def train(
    config: Mapping[str, Any],
    *,
    resume: bool = False,
    make: Callable[[Mapping[str, Any]], Algorithm],
    report: Callable[[Status], None] = lambda status: None,
    note: Callable[[str], None] = lambda line: None,
    interrupted: Callable[[], bool] = lambda: False,
) -> Trained:
    """The whole main job; what fails on the way goes on from the last checkpoint.

    Args:
        config: a complete tree (``config.load``), its paths absolute (`config.paths`).
        resume: go on from the run's newest checkpoint; without one, begin.
        make: the algorithm's factory.
        report, note, interrupted: see Training.

    Raises:
        DomainError, RunError: see `prepare`.
        ConfigError: a setting that cannot be had here, as a GPU.
        TrainingError: it failed more often in a row than ``checkpoint.retries``.
        CheckpointError: none of its checkpoints can be read.
        OutputError: something cannot be written.
    """
    folder = prepare(config, resume)
    failures = 0
    while True:
        before = [path.name for path in checkpoint.found(folder.checkpoints)]
        try:
            return _attempt(config, folder, resume, failures, make, report, note, interrupted)
        except FINAL:
            raise
        except Exception as error:
            brief = (str(error) or type(error).__name__).strip().splitlines()[0][:200]
            _write_down(folder, error)
            now = [path.name for path in checkpoint.found(folder.checkpoints)]
            failures = 1 if now[:1] != before[:1] else failures + 1
            if failures > config["checkpoint"]["retries"]:
                raise TrainingError(
                    f"{folder.path}: {brief} ({folder.failures.name} has more): mend the cause, --resume goes on from "
                    f"{now[0] if now else 'the start'}"
                ) from error
            note(f"{brief}; going back to {now[0] if now else 'the start'} (failure {failures} in a row)")
            resume = True


def _attempt(
    config: Mapping[str, Any],
    folder: RunFolder,
    resume: bool,
    failures: int,
    make: Callable[[Mapping[str, Any]], Algorithm],
    report: Callable[[Status], None],
    note: Callable[[str], None],
    interrupted: Callable[[], bool],
) -> Trained:
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
            enabled=tracking["enabled"],
        ) as run,
    ):
        training = Training(algorithm, config, folder, run, report, note, interrupted)
        if resume:
            training.resume()
        if failures:
            algorithm.reseed(failures)
        with replacing(folder.config) as draft:
            draft.write_text(dump(config))
        run.artifact(folder.config)
        training.loop()
        produced = deliver(training)
    return Trained(training.progress, folder.policy, checkpoint.found(folder.checkpoints)[0], folder.curve, produced)


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
    with suppress(OSError), open(folder.failures, "a") as file:
        file.write(f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC\n{''.join(traceback.format_exception(error))}\n")


def tags(config: Mapping[str, Any]) -> dict[str, str]:
    """What runs are told apart by in the tracking store."""
    return {
        "algorithm": config["algorithm"],
        "seed": str(config["seed"]),
        "domain": ",".join(config["curriculum"]["stages"]),
    }


#: What a run cannot change when it goes on: its experience and its networks are of these.
FIXED = ("algorithm", "env.", "learner.hidden", "curriculum.stages")


def prepare(config: Mapping[str, Any], resume: bool) -> RunFolder:
    """What can be wrong before anything is started: the stages, the run that goes on, and its folder, which is made.

    Raises:
        DomainError: a stage that cannot be meshed or trained on, or two of one name.
        RunError: the run has checkpoints and ``resume`` is false, it was begun with other settings, or its folder
            cannot be made.
    """
    check_stages(config)
    folder = RunFolder(Path(config["paths"]["runs"]) / config["name"])
    if resume and checkpoint.found(folder.checkpoints) and folder.config.is_file():
        check_unchanged(folder, config)
    folder.claim(resume)
    return folder


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


def check_unchanged(folder: RunFolder, config: Mapping[str, Any]) -> None:
    """Refuse to go on with other `FIXED` settings than the run began with.

    Raises:
        RunError: one differs.
    """
    before, now = flatten(load_config([folder.config])), flatten(config)
    for key, value in now.items():
        if key.startswith(FIXED) and before[key] != value:
            raise RunError(
                f"{folder.path} was begun with {key} = {before[key]}, not {value}: go on with the same, "
                "or --set name=OTHER to begin another"
            )


def deliver(training: Training) -> list[Produced]:
    """What a training that came to its end leaves: every stage meshed with the best policy, and the learning curve.

    Files and the meshes' figures are tracked.
    """
    policy = Policy.load(training.folder.policy)
    produced = []
    for stage in training.config["curriculum"]["stages"]:
        domain = source(stage)
        example = domain if isinstance(domain, Domain) else domain.held_out(1)[0]
        entry = produce(policy, example, training.folder.meshes)
        training.run.metrics(
            {f"mesh/{entry.domain}/{name}": value for name, value in entry.figures.items()},
            step=training.progress.env_steps,
        )
        produced.append(entry)
    curve = draw_curve(training.folder)
    for path in [training.folder.policy, curve, *(file for entry in produced for file in entry.files)]:
        training.run.artifact(path, "meshes" if path.parent.name == "meshes" else None)
    return produced


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
