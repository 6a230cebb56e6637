"""A study run: what is found is not trained again, the rest goes to Ray Tune, the best policy is registered.

definition -> plan -> [ found finished | Tuner(TrialTrainable) ] -> trials.json -> best policy -> report
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from ray import tune

from freemesh_ray.config import flatten
from freemesh_ray.storage.lock import held, holder
from freemesh_ray.studies import progress, search
from freemesh_ray.studies.definition import Study
from freemesh_ray.studies.plan import Plan, SearchPlan, VariantPlan, variant_plan
from freemesh_ray.studies.result import StudyResult, TrialResult, best_trial
from freemesh_ray.studies.study_folder import OVER, StudyError, StudyFolder, TrialRecord
from freemesh_ray.studies.trainable import TrialTrainable, finished, resources
from freemesh_ray.tracking import MLflowRun, share
from freemesh_ray.tracking.provenance import source
from freemesh_ray.training.callback import Callback
from freemesh_ray.training.job import tags
from freemesh_ray.training.loop import Algorithm

#: Checkpoints kept of each trial: Tune's record of them is a second old at most, and population based training copies
#: from one while its trial goes on.
KEPT = 4
#: Seconds that Tune gets to end its trials after a signal: the whole is to end in ten.
PEACE_SECONDS = 3.0
#: Keeps Ray Tune from printing and writing beside the study's own, and trials in the folder that relative paths of the
#: settings are relative to.
QUIET = {
    "RAY_CHDIR_TO_TRIAL_DIR": "0",
    "RAY_AIR_NEW_OUTPUT": "0",
    "TUNE_GLOBAL_CHECKPOINT_S": "1",
    "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",
    "TUNE_DISABLE_SIGINT_HANDLER": "1",  # see `ended_by_signals`
    "TUNE_MAX_PENDING_TRIALS_PG": "1",
    "TUNE_WARN_EXCESSIVE_EXPERIMENT_CHECKPOINT_SYNC_THRESHOLD_S": "0",
}


def planned(study: Study) -> tuple[StudyFolder, Plan, list[TrialRecord]]:
    """Where a study lies, its plan, and its trials as far as they are known before it runs."""
    settings = study.settings_of_all()
    folder = StudyFolder(Path(settings["paths"]["studies"]) / study.name)
    if study.search:
        return folder, SearchPlan(study, folder.runs), []
    plan = variant_plan(study, source())
    records = []
    for trial in plan.trials.values():
        done = finished(trial.folder) is not None
        run = os.path.relpath(trial.folder.path, folder.path)
        records.append(TrialRecord(trial.label, trial.seed, run, "finished" if done else "pending", shared=done))
    return folder, plan, records


def run(
    study: Study,
    *,
    resume: bool,
    make: Callable[[Mapping[str, Any]], Algorithm],
    report: Callable[[Path], object] = lambda folder: None,
    callbacks: Sequence[Callback] = (),
    note: Callable[[str], None] = lambda line: None,
) -> StudyResult:
    """Run a study, or go on with it; Ray is up.

    Args:
        study: it.
        resume: go on where it stopped: finished trials stay, running ones go on from their checkpoints.
        make: the algorithm's factory.
        report: writes the report into the study's folder; its files are tracked.
        callbacks: of every trial's training, in its process.
        note: called with lines of progress.

    Raises:
        StudyError: there is such a study, and ``resume`` is false, it is another, or it was begun from another source.
        InUseError: another process runs it.
        KeyboardInterrupt: it was interrupted; ``resume`` goes on.
    """
    folder, plan, records = planned(study)
    folder.claim(study, resume)
    settings = study.settings_of_all()
    tracking = settings["tracking"]
    with (
        held(folder.path, "wait for its end"),
        MLflowRun(
            folder.path,
            uri=tracking["uri"],
            experiment=tracking["experiment"],
            name=study.name,
            params=flatten(study.tree()),
            tags={"study": study.name},
            resume=resume,
            folders=[*settings["paths"].values()],
            enabled=tracking["enabled"],
        ) as parent,
    ):
        records = merged(records, folder.read())
        parent.artifact(folder.definition)
        folder.write(records)
        note(opening(study, folder, records))
        if isinstance(plan, VariantPlan):
            share_finished(study, folder.path, plan, records, tracking, parent.id)
        total = study.search.trials if study.search else len(records)
        if sum(record.status in ("finished", "stopped") for record in records) < total:
            with telling(note):
                trainable = tune.with_parameters(
                    TrialTrainable, make=make, callbacks=callbacks, plan=plan, study=study.name, parent=parent.id
                )
                records = run_trials(study, folder, plan, records, total, trainable)
            if isinstance(plan, VariantPlan):  # those that another study trained meanwhile
                share_finished(study, folder.path, plan, records, tracking, parent.id)
        if sum(record.status in OVER for record in records) < total:
            raise KeyboardInterrupt
        trials = [TrialResult.of(record, folder) for record in records]
        result = StudyResult(folder, trials, best_trial(trials, study.metric))
        if result.best is not None:
            register_best(parent, study, result.best)
        report(folder.path)
        for path in [folder.trials, *result.report]:
            parent.artifact(path, "report" if path.parent == folder.report else None)
    return result


def merged(expected: list[TrialRecord], before: list[TrialRecord]) -> list[TrialRecord]:
    """The trials of a study that goes on: as they were left, but for what was finished since.

    Raises:
        StudyError: the trials are others now: they were begun from another commit, or source.
    """
    known = {record.name: record for record in before}
    for record in expected:
        old = known.get(record.name)
        if old is not None and old.run != record.run:
            raise StudyError(
                f"{record.name}: was begun from another commit, or source: go on from that one, "
                "or --set paths.studies=OTHER to begin anew"
            )
        if old is not None and record.status == "finished":
            record.shared = old.shared or old.status == "pending"
        elif old is not None:
            record.status = "pending" if old.status == "finished" else old.status
    return expected or before


def share_finished(
    study: Study,
    folder: Path,
    plan: VariantPlan,
    records: list[TrialRecord],
    tracking: Mapping[str, Any],
    parent: str | None,
) -> None:
    """List trials that another study trained among this study's runs in the tracking store, too."""
    if not tracking["enabled"] or parent is None:
        return
    for record in records:
        if record.status == "finished":
            trial = plan.trials[record.name]
            share(
                trial.folder.path,
                uri=tracking["uri"],
                experiment=tracking["experiment"],
                name=trial.name,
                tags={**tags(trial.config), "study": study.name, "variant": trial.label},
                parent=parent,
                into=folder,
            )


@contextmanager
def telling(note: Callable[[str], None]) -> Iterator[None]:
    """Ray Tune as part of a study: it is quiet, and its progress goes to ``note``."""
    before = {name: os.environ.get(name) for name in QUIET}
    token = progress.note.set(note)
    os.environ.update(QUIET)
    try:
        yield
    finally:
        progress.note.reset(token)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def run_trials(
    study: Study, folder: StudyFolder, plan: Plan, records: list[TrialRecord], total: int, trainable: Any
) -> list[TrialRecord]:
    """Run the trials that are not over on Ray Tune.

    Returns:
        All trials as they are then.
    """
    settings = study.settings_of_all()
    trainable = tune.with_resources(trainable, partial(resources_of, plan))
    pbt = study.search is not None and study.search.scheduler == "pbt"
    if tune.Tuner.can_restore(str(folder.tune)):
        tuner = tune.Tuner.restore(str(folder.tune), trainable, resume_unfinished=True, resume_errored=True)
    else:
        left = [record.name for record in records if record.status != "finished"]
        tuner = tune.Tuner(
            trainable,
            param_space=search.param_space(study.search) if study.search else {"trial": tune.grid_search(left)},
            tune_config=tune.TuneConfig(
                num_samples=study.search.trials if study.search else 1,
                search_alg=search.searcher(study) if study.search else None,
                scheduler=search.scheduler(study, settings["budget"]["env_steps"]),
                max_concurrent_trials=parallel(settings) if study.search and not pbt else None,
                reuse_actors=True,
            ),
            run_config=tune.RunConfig(
                name=folder.tune.name,
                storage_path=str(folder.path),
                failure_config=tune.FailureConfig(max_failures=study.retries),
                checkpoint_config=tune.CheckpointConfig(checkpoint_frequency=1, num_to_keep=KEPT),
                callbacks=[progress.StudyProgress(folder.path, plan, total, settings["budget"]["env_steps"], pbt)],
                verbose=0,
            ),
        )
    with ended_by_signals():
        tuner.fit()
    return folder.read()


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let Tune end the study in peace at the first SIGINT, SIGTERM or SIGHUP, for `PEACE_SECONDS` at most, or until the
    second: where trials are amid a step it would take a quarter of a minute.
    """

    if threading.current_thread() is not threading.main_thread():
        yield  # signals are the main thread's
        return

    def end(number: int, frame: FrameType | None) -> None:
        if timers:
            raise KeyboardInterrupt
        os.kill(os.getpid(), signal.SIGUSR1)  # Tune obeys it, too
        timers.append(threading.Timer(PEACE_SECONDS, os.kill, (os.getpid(), signal.SIGINT)))
        timers[0].daemon = True
        timers[0].start()

    timers: list[threading.Timer] = []
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # as `nohup` leaves it
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, end) for number in numbers}
    try:
        yield
    finally:
        for timer in timers:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


def resources_of(plan: Plan, given: Mapping[str, Any]) -> tune.PlacementGroupFactory:
    """What the trial of Tune's configuration takes."""
    return resources(plan.trial(given, "").config)


def parallel(settings: Mapping[str, Any]) -> int:
    """How many trials this machine, or cluster, runs side by side."""
    import ray

    processes = 1 + settings["runners"]["count"] + settings["learner"]["count"]
    return max(1, int(ray.cluster_resources().get("CPU", 1)) // processes)


def register_best(parent: MLflowRun, study: Study, best: TrialResult) -> None:
    """Make the best policy a version of the study's registered model, under the alias `best`; not one that plug-ins
    keep from meshing as a model does.
    """
    assert best.policy is not None
    if best.policy.plug_ins.alter:
        return
    parent.model(
        best.folder.policy,
        name=f"freemesh-{study.name}",
        alias="best",
        tags={
            "study": study.name,
            "variant": best.label,
            "algorithm": best.policy.about["config"]["algorithm"],
            "seed": str(best.seed),
            study.metric: f"{float(best.figures[study.metric]):.6g}",
        },
    )


def opening(study: Study, folder: StudyFolder, records: list[TrialRecord]) -> str:
    """What is about to happen, in lines."""
    settings = study.settings_of_all()
    found = sum(record.status == "finished" for record in records)
    count = study.search.trials if study.search else len(records)
    steps = settings["budget"]["env_steps"]
    known = f", {found} of them trained before" if found else ""
    lines = [
        study.title,
        f"{count} trials of {steps:,} env steps{known}, {parallel(settings)} at a time -> {folder.path}",
    ]
    for record in records:
        if record.status != "finished" and (by := holder(folder.run_of(record).path)):
            lines.append(f"{record.label}-{record.seed} is waited for: {by}")
    return "\n".join(lines)
