"""Where results may be read from: a study by its name; a records file, its folder, a study's folder, a run's folder."""

from __future__ import annotations

from pathlib import Path

from freemesh_ray.config import ConfigError, flatten, read_plain
from freemesh_ray.policies.evaluation import SCORE
from freemesh_ray.records.schema import FILE
from freemesh_ray.report.results import Results, TrialResult, from_records, number, read
from freemesh_ray.studies.completion_mark import finished
from freemesh_ray.studies.definition import Study
from freemesh_ray.studies.plan import LENGTH
from freemesh_ray.studies.study_folder import StudyError, StudyFolder, TrialRecord


def results_of(given: str, studies: Path) -> Results:
    """The results that an argument names.

    Args:
        given: a study's name, or the path of a records file, of its folder, or of a study's or a run's folder.
        studies: folder of the studies.

    Raises:
        StudyError, ConfigError, RecordsError, RunError: there are none, or they cannot be read.
    """
    path = Path(given)
    if StudyFolder(studies / given).definition.is_file():
        return read(studies / given)
    if path.is_file():
        return from_records(path)
    if (path / FILE).is_file():
        return from_records(path / FILE)
    if StudyFolder(path).definition.is_file():
        return read(path)
    if (path / "evaluations.jsonl").is_file():
        return of_run(path)
    return read(studies / given)


def of_run(path: Path) -> Results:
    """A single training as results of a study of its own, judged by the score.

    Raises:
        StudyError: its configuration cannot be read.
        RunError: nor its evaluations.
    """
    run, name = StudyFolder(path).run_of(TrialRecord("", 0, "")), path.resolve().name
    try:
        config = flatten(read_plain(run.config))
        seed, budget = (int(number(config[key])) for key in ("seed", LENGTH))
    except (AttributeError, ConfigError, KeyError, ValueError, OverflowError) as error:
        raise StudyError(f"{run.config}: is no configuration of a training: give the folder of another") from error
    evaluations = run.read_evaluations()
    whole = finished(run) is not None or bool(evaluations and evaluations[-1]["env_steps"] >= budget)
    status = "finished" if whole else "stopped"
    trial = TrialResult(name, seed, name, run.policy, status, config=config, evaluations=evaluations)
    study = Study(name=name, title=name, settings=[], variants={name: []}, seeds=[seed], metric=SCORE)
    return Results(study, [trial], single=True)
