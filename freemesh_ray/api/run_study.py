"""A study from Python: ``freemesh_ray.study("mine.yaml")``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from freemesh_ray.local_ray import environment, local_ray

if TYPE_CHECKING:
    from freemesh_ray.studies.definition import Study
    from freemesh_ray.studies.returned import StudyResult
    from freemesh_ray.studies.study_folder import StudyFolder
    from freemesh_ray.training.callback import Callback


def study(
    source: str | Path | Mapping[str, Any],
    *,
    callbacks: Sequence[Callback] = (),
    resume: bool = False,
    add: Sequence[str] = (),
    records: Sequence[str | Path] = (),
    note: Callable[[str], None] = lambda line: None,
) -> StudyResult:
    """Run a study of many trainings on Ray Tune, track it and report on it, as ``freemesh study`` does.

    Ctrl-C stops it. A Ray that is up is used, and stays; else one is started, and ended.

    Args:
        source: a YAML file, the name of a study that ships with the package, or a mapping with the file's parts
            ``study`` and ``settings``, whose folder is then named after its title.
        callbacks: of every trial's training; each trial has copies in a process of its own.
        resume: go on where it stopped, if it was begun, with what ``source`` has more than it had then.
        add: ``KEY=VALUE``, as ``seeds=4,5``: go on with what was begun, and more (`freemesh study --add`).
        records: files, or folders that hold some: trainings in them count as finished (`freemesh study --records`).
        note: called with lines of progress, as ``print``.

    Raises:
        ConfigError, DomainError, StudyError, RecordsError, InUseError: what is wrong with the input.
        KeyboardInterrupt: Ctrl-C; ``resume`` goes on.
    """
    environment()
    from freemesh_ray.studies.definition import load

    if add:
        name = source if isinstance(source, str | Path) else load(source).name
        return run(longer(name, add), callbacks, True, note, records)
    return run(load(source), callbacks, resume, note, records)


def longer(source: str | Path, add: Sequence[str], sets: Sequence[str] = (), *, smoke: bool = False) -> Study:
    """A study that was begun, with what ``KEY=VALUE`` strings add to it.

    Args:
        source: its name or file.
        add: see `freemesh_ray.studies.permitted_changes.extended`.
        sets: ``key=value`` that say where it lies: of ``paths`` alone.
        smoke: the one that was begun with ``--smoke``.

    Raises:
        StudyError: it was not begun.
        ConfigError: what is wrong with an addition.
    """
    from freemesh_ray.config import ConfigError
    from freemesh_ray.studies.permitted_changes import extended

    if other := next((text for text in sets if not text.strip().startswith("paths.")), None):
        raise ConfigError(f"--set {other}: --add goes on with the settings that are written down: leave it out")
    return extended(begun(source, sets, smoke).study(), add)


def begun(source: str | Path, sets: Sequence[str], smoke: bool) -> StudyFolder:
    """Where the study of a name, or a file, lies."""
    from freemesh_ray import config
    from freemesh_ray.config.paths import Paths
    from freemesh_ray.studies.definition import load, shipped
    from freemesh_ray.studies.runner import folder_of
    from freemesh_ray.studies.study_folder import StudyFolder

    if Path(source).is_file() or str(source) in shipped():
        return folder_of(load(source, sets, smoke=smoke))
    studies = Paths.from_environment().resolved(config.load(sets=sets))["paths"]["studies"]
    return StudyFolder(Path(studies) / f"{Path(source).stem}{'-smoke' if smoke else ''}")


def run(
    study: Study,
    callbacks: Sequence[Callback],
    resume: bool,
    note: Callable[[str], None],
    records: Sequence[str | Path] = (),
) -> StudyResult:
    """`study` of one that was read."""
    from freemesh_ray.studies import uptake
    from freemesh_ray.studies.runner import prepare

    recorded = uptake.read(records) if records else None

    check(study)
    prepare(study, resume)
    settings = study.settings_of_all()
    processes = settings["runners"]["count"] + settings["learner"]["count"]
    with local_ray(processes, "--resume goes on from the last checkpoints"):
        from freemesh_ray.algorithms.build import build
        from freemesh_ray.algorithms.device import cluster_gpus, gpus_per_learner
        from freemesh_ray.api.study_description import at_end
        from freemesh_ray.studies import runner

        gpus_per_learner(settings["learner"]["device"], settings["learner"]["count"], cluster_gpus())
        return runner.run(
            study, resume=resume, make=build, report=at_end, callbacks=callbacks, recorded=recorded, note=note
        )


def check(study: Study) -> None:
    """Refuse domains that cannot be trained on or meshed, and plug-ins that fail at once, before anything is started.

    Raises:
        DomainError, PluginError: as said.
    """
    from envs.domains.load import load as load_domain
    from freemesh_ray.training.job import check_plug_ins, check_stages

    for domain in study.domains:
        load_domain(domain)
    for config in trees_of(study):
        check_stages(config)
        check_plug_ins(config)


def trees_of(study: Study) -> list[dict[str, Any]]:
    """The complete tree of every variant; of a search that of what its trials share."""
    return [study.trial_config(label, 0) for label in study.variants] or [study.settings_of_all()]
