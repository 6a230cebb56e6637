"""A study run: what is found is not trained again, the rest goes to Ray Tune, the best policy is registered.

definition -> plan -> [ found finished | Tuner(TrialTrainable) ] -> trials.json -> (confirmation of a search, the
same way) -> best policy -> report
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from ray import tune

from freemesh_ray.config import flatten, store_login
from freemesh_ray.records.study_records import Training
from freemesh_ray.storage.lock import held, holder
from freemesh_ray.studies import progress, tune_search
from freemesh_ray.studies.completion_mark import finished
from freemesh_ray.studies.confirmation import confirmation_plan, draws, of_search, score
from freemesh_ray.studies.definition import Study
from freemesh_ray.studies.plan import Plan, SearchPlan, VariantPlan, lineage, variant_plan
from freemesh_ray.studies.returned import StudyResult, TrialResult, best_trial
from freemesh_ray.studies.study_folder import OVER, StudyError, StudyFolder, TrialRecord
from freemesh_ray.studies.trainable import TrialTrainable, resources
from freemesh_ray.studies.training_source import training_source
from freemesh_ray.studies.uptake import take_up
from freemesh_ray.tracking import MLflowRun, share
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


def folder_of(study: Study) -> StudyFolder:
    """Where a study lies."""
    return StudyFolder(Path(study.settings_of_all()["paths"]["studies"]) / study.name)


def planned(study: Study) -> tuple[StudyFolder, Plan, list[TrialRecord]]:
    """Where a study lies, its plan, and its trials as far as they are known before it runs."""
    folder = folder_of(study)
    if study.search:
        return folder, SearchPlan(study, folder.runs), []
    plan = variant_plan(study, training_source())
    return folder, plan, records_of(plan, folder)


def records_of(plan: VariantPlan, folder: StudyFolder) -> list[TrialRecord]:
    """The trials of a plan as they are found."""
    records = []
    for trial in plan.trials.values():
        done = finished(trial.folder) is not None
        run = os.path.relpath(trial.folder.path, folder.path)
        drawn = dict(trial.drawn) if trial.drawn else None
        status = "finished" if done else "pending"
        records.append(TrialRecord(trial.label, trial.seed, run, status, settings=drawn, shared=done))
    return records


def prepare(study: Study, resume: bool) -> None:
    """Before Ray is started: see what `run` would refuse.

    Raises:
        StudyError: as `run`.
    """
    folder, _, records = planned(folder_of(study).going_on(study, resume))
    merged(records, folder.read(), folder.changed_source())


def run(
    study: Study,
    *,
    resume: bool,
    make: Callable[[Mapping[str, Any]], Algorithm],
    report: Callable[[Path, MLflowRun], object] = lambda folder, run: None,
    callbacks: Sequence[Callback] = (),
    recorded: Mapping[str, Training] | None = None,
    note: Callable[[str], None] = lambda line: None,
) -> StudyResult:
    """Run a study, or go on with it; Ray is up.

    Args:
        study: it.
        resume: go on where it stopped, with what it was extended by: finished trials stay, or go on where their budget
            grew, running ones go on from their checkpoints.
        make: the algorithm's factory.
        report: writes the report into the study's folder, whose files are tracked, and describes the study's run.
        callbacks: of every trial's training, in its process.
        recorded: trainings in records by the names of their run folders (`uptake.read`): they count as finished.
        note: called with lines of progress.

    Raises:
        StudyError: there is such a study, and ``resume`` is false, it is another, or it was begun with another source.
        InUseError: another process runs it.
        KeyboardInterrupt: it was interrupted; ``resume`` goes on.
    """
    prepare(study, resume)
    folder = folder_of(study)
    folder.make()
    with held(folder.path, "wait for its end"):
        study = folder.claim(study, resume)
        settings = study.settings_of_all()
        tracking = settings["tracking"]
        with MLflowRun(
            folder.path,
            uri=tracking["uri"],
            experiment=tracking["experiment"],
            name=study.name,
            params=flatten(study.tree()),
            tags={"study": study.name},
            resume=resume,
            folders=[*settings["paths"].values()],
            enabled=tracking["enabled"],
        ) as parent:
            parent.artifact(folder.definition)
            take_up_recorded(planned(study)[1], recorded, note)
            _, plan, records = planned(study)
            records = merged(records, folder.read(), folder.changed_source())
            folder.write(records)
            note(opening(study, folder, records))
            given = {"make": make, "callbacks": callbacks, "study": study.name, "logins": store_login.known()}
            trainable = partial(tune.with_parameters, TrialTrainable, **given)
            of_all = Phase(plan, folder.tune, study.trainings(), partial(of_search, study))
            train(study, folder, of_all, trainable, parent, note)
            if study.search and study.search.confirm:
                confirm, records = confirmed(study, folder, recorded, note)
                folder.write(records)
                note(confirming(study, confirm))
                again = Phase(confirm, folder.tune_confirm, len(confirm.trials), partial(of_plan, confirm))
                train(study, folder, again, trainable, parent, note)
            trials = [TrialResult.of(record, folder) for record in folder.read()]
            result = StudyResult(folder, trials, best_trial(trials, study.metric))
            if told := without_policy(trials):
                note(told)
            if result.best is not None:
                register_best(parent, study, result.best)
            report(folder.path, parent)
            for path in [folder.trials, *result.report]:
                parent.artifact(path, "report" if path.parent == folder.report else None)
    return replace(result, page=parent.page)


@dataclass(frozen=True)
class Phase:
    """Trials that Ray Tune runs as one experiment.

    Attributes:
        plan: of them.
        experiment: Tune's folder.
        total: how many trainings they are.
        own: of all records of the study theirs.
    """

    plan: Plan
    experiment: Path
    total: int
    own: Callable[[Sequence[TrialRecord]], list[TrialRecord]]

    def left(self, records: Sequence[TrialRecord], over: Sequence[str]) -> int:
        """How many are in none of the states ``over``."""
        return self.total - sum(record.status in over for record in self.own(records))


def train(
    study: Study,
    folder: StudyFolder,
    phase: Phase,
    trainable: Callable[..., Any],
    parent: MLflowRun,
    note: Callable[[str], None],
) -> None:
    """Train what of a phase is not over; failed trials are tried again.

    Raises:
        KeyboardInterrupt: it was interrupted.
    """
    tracking = study.settings_of_all()["tracking"]

    def share_those() -> None:
        if isinstance(phase.plan, VariantPlan):
            share_finished(study, folder.path, phase.plan, phase.own(folder.read()), tracking, parent.id)

    share_those()
    if phase.left(folder.read(), ("finished", "stopped")) > 0:
        with telling(note):
            run_trials(study, folder, phase, trainable(plan=phase.plan, parent=parent.id))
        share_those()  # those that another study trained meanwhile
    if phase.left(folder.read(), OVER) > 0:
        raise KeyboardInterrupt


def of_plan(plan: VariantPlan, records: Sequence[TrialRecord]) -> list[TrialRecord]:
    """The trainings of a plan."""
    return [record for record in records if record.name in plan.trials]


def take_up_recorded(plan: Plan, recorded: Mapping[str, Training] | None, note: Callable[[str], None]) -> None:
    """Open the recorded trainings of a plan into their run folders, and say how many match.

    Raises:
        InUseError: another process trains one.
    """
    if recorded is None:
        return
    if isinstance(plan, VariantPlan):
        note(str(take_up(plan, recorded)))
    else:
        note("records: draws of a search are not taken up, as each depends on those before; what confirms them may be")


def without_policy(trials: Sequence[TrialResult]) -> str:
    """How many trainings that are over have no policy here, in a line; empty where all have one."""
    over = [trial for trial in trials if trial.status == "finished"]
    lacking = sum(not trial.folder.policy.is_file() for trial in over)
    if not lacking:
        return ""
    best = "the best is chosen among the others" if lacking < len(over) else "no policy is registered"
    return f"{lacking} of {len(over)} finished trainings are from records, without their policies: {best}"


def confirmed(
    study: Study, folder: StudyFolder, recorded: Mapping[str, Training] | None, note: Callable[[str], None]
) -> tuple[VariantPlan, list[TrialRecord]]:
    """The trainings that confirm a search which is over, and all of the study's with them.

    Raises:
        StudyError: they were begun with another source.
    """
    before = folder.read()
    plan = confirmation_plan(study, folder, before, training_source())
    if plan.trials:
        take_up_recorded(plan, recorded, note)
    again = merged(records_of(plan, folder), before, folder.changed_source()) if plan.trials else []
    return plan, [*(record for record in before if record.name not in plan.trials), *again]


def confirming(study: Study, plan: VariantPlan) -> str:
    """What confirms a search, in a line."""
    labels = dict.fromkeys(trial.label for trial in plan.trials.values())
    if not labels:
        return "nothing to confirm: no draw completed a mesh at its end"
    seeds = dict.fromkeys(trial.seed for trial in plan.trials.values())
    return f"{', '.join(labels)} again on {len(seeds)} fresh seeds: {', '.join(map(str, seeds))}"


def merged(expected: list[TrialRecord], before: list[TrialRecord], changed: str = "") -> list[TrialRecord]:
    """The trials of a study that goes on: as they were left, but for what was finished since, or is longer now.

    Args:
        expected: as they are found.
        before: as they were left.
        changed: what of the source is another now, in words.

    Raises:
        StudyError: the trials are others now: they were begun with another source.
    """
    known = {record.name: record for record in before}
    for record in expected:
        old = known.get(record.name)
        if old is None:
            continue
        if old.run != record.run:
            if lineage(old.run) != lineage(record.run):
                raise StudyError(
                    f"{record.name}: was begun with other code of training, plug-ins or domains{changed}: "
                    "go on with those, or --set paths.studies=OTHER to begin anew"
                )
        elif record.status == "finished":
            record.shared = old.shared or old.status == "pending"
        else:
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
        trial = plan.trials[record.name]
        if record.status == "finished" and trial.folder.policy.is_file():  # one from records was tracked elsewhere
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


def run_trials(study: Study, folder: StudyFolder, phase: Phase, trainable: Any) -> None:
    """Run the trials of a phase that are not over on Ray Tune."""
    settings = study.settings_of_all()
    trainable = tune.with_resources(trainable, partial(resources_of, phase.plan))
    if tune.Tuner.can_restore(str(phase.experiment)):
        tuner = tune.Tuner.restore(str(phase.experiment), trainable, resume_unfinished=True, resume_errored=True)
    else:
        records = folder.read()
        keep = study.search is not None and study.search.scheduler == "pbt"
        planned = len(records) - len(phase.own(records)) + phase.total
        steps = settings["budget"]["env_steps"]
        told = progress.StudyProgress(folder.path, phase.experiment, phase.plan, planned, steps, keep)
        space, how = drawn(study, folder, phase) if isinstance(phase.plan, SearchPlan) else listed(folder, phase)
        tuner = tune.Tuner(
            trainable,
            param_space=space,
            tune_config=how,
            run_config=tune.RunConfig(
                name=phase.experiment.name,
                storage_path=str(folder.path),
                failure_config=tune.FailureConfig(max_failures=study.retries),
                checkpoint_config=tune.CheckpointConfig(checkpoint_frequency=1, num_to_keep=KEPT),
                callbacks=[told],
                verbose=0,
            ),
        )
    with ended_by_signals():
        tuner.fit()


def listed(folder: StudyFolder, phase: Phase) -> tuple[dict[str, Any], tune.TuneConfig]:
    """What Tune runs of trials that are known."""
    left = [record.name for record in phase.own(folder.read()) if record.status != "finished"]
    return {"trial": tune.grid_search(left)}, tune.TuneConfig(
        scheduler=tune_search.scheduler(None, 0), reuse_actors=True
    )


def drawn(study: Study, folder: StudyFolder, phase: Phase) -> tuple[dict[str, Any], tune.TuneConfig]:
    """What Tune runs of a search: as many draws as are not known yet."""
    assert study.search is not None
    settings = study.settings_of_all()
    known = {
        label: (tune_search.as_drawn(study, records[0].settings or {}), score(folder, records, study.metric))
        for label, records in draws(study, folder.read()).items()
        if all(record.status in OVER for record in records)
    }
    pbt = study.search.scheduler == "pbt"
    return tune_search.param_space(study.search), tune.TuneConfig(
        num_samples=study.search.trials - len(known),
        search_alg=tune_search.searcher(study, list(known.values())),
        scheduler=tune_search.scheduler(study, settings["budget"]["env_steps"]),
        max_concurrent_trials=None if pbt else parallel(settings),
        reuse_actors=True,
    )


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let Tune end the study in peace at the first SIGINT, SIGTERM or SIGHUP, for `PEACE_SECONDS` at most, or until the
    second: where trials are amid a step it would take a quarter of a minute. What runs then is interrupted until it
    ends: an interruption that comes amid a clean-up of Python's own is lost.
    """

    if threading.current_thread() is not threading.main_thread():
        yield  # signals are the main thread's
        return

    over = threading.Event()
    insisting = threading.Thread(target=insist, args=(over,), daemon=True)

    def end(number: int, frame: FrameType | None) -> None:
        if insisting.ident is not None:
            raise KeyboardInterrupt
        insisting.start()
        os.kill(os.getpid(), signal.SIGUSR1)  # Tune obeys it, too

    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # as `nohup` leaves it
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, end) for number in numbers}
    try:
        yield
    finally:
        over.set()
        for number, handler in before.items():
            signal.signal(number, handler)


def insist(over: threading.Event) -> None:
    """Interrupt the main thread after `PEACE_SECONDS`, and each second from then on, until it is over."""
    wait = PEACE_SECONDS
    while not over.wait(wait):
        os.kill(os.getpid(), signal.SIGINT)
        wait = 1.0


def resources_of(plan: Plan, given: Mapping[str, Any]) -> tune.PlacementGroupFactory:
    """What the trial of Tune's configuration takes."""
    return resources(plan.trainings(given, "")[0].config)


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
    own = of_search(study, records)
    found = sum(record.status == "finished" for record in own)
    steps = settings["budget"]["env_steps"]
    known = f", {found} of them trained before" if found else ""
    lines = [
        study.title,
        f"{study.trainings()} trials of {steps:,} env steps{known}, {parallel(settings)} at a time -> {folder.path}",
    ]
    for record in records:
        if record.status != "finished" and (by := holder(folder.run_of(record).path)):
            lines.append(f"{record.name} is waited for: {by}")
    return "\n".join(lines)
