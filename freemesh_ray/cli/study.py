"""``freemesh study``: its grammar and what it calls."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from os.path import normpath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from freemesh_ray.cli.arguments import add_command, add_settings
from freemesh_ray.config.paths import pasted
from freemesh_ray.formatting.table import table
from freemesh_ray.formatting.terminal import note, say
from freemesh_ray.tracking import browsing

if TYPE_CHECKING:
    from freemesh_ray.studies.definition import Study
    from freemesh_ray.studies.returned import StudyResult, TrialResult

EPILOG = """\
examples:
  freemesh study algorithms --dry-run             the trials, and nothing else
  freemesh study algorithms --smoke               the whole path in about a minute
  freemesh study algorithms                       run it; Ctrl-C stops it, --resume goes on
  freemesh study mine.yaml --set budget.env_steps=1.2e6
  freemesh study mine.yaml --resume               go on, also with what the file has more by now
  freemesh study mine --add seeds=4,5 --add env_steps=800000
  freemesh study algorithms --records docs/studies     what is recorded there is not trained again
  freemesh report algorithms                      its figures and tables

A study is one YAML file; those that ship are in tune_configs. Trials run side by side, as many as the machine has
cores for. A training that another study has done already, with the same settings, seed and source, is not repeated.
"""


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    study = add_command(
        commands,
        "study",
        "run a study of many trainings",
        "Run a study on Ray Tune, track it in MLflow and report on it.",
        EPILOG,
    )
    study.add_argument("study", nargs="?", metavar="STUDY", help="a name (without one: the list), or a YAML file")
    add_settings(study, "of all trials")
    study.add_argument("--resume", action="store_true", help="go on where it stopped, if it was begun")
    study.add_argument(
        "--add", action="append", default=[], metavar="KEY=VALUE",
        help="go on with more: seeds=4,5, more_seeds='{LABEL: [6, 7]}', domains=D4, expects='A > B', "
        "variants='{LABEL: {KEY: VALUE}}', trials=N or env_steps=N more; repeatable",
    )  # fmt: skip
    study.add_argument(
        "--records", action="append", default=[], metavar="FILE",
        help="records.parquet of a report, or a folder that holds some: a training in it, of the same settings, seed, "
        "steps and source, counts as finished; repeatable",
    )  # fmt: skip
    study.add_argument("--dry-run", action="store_true", help="print the trials and stop")
    study.add_argument("--smoke", action="store_true", help="the whole path with tiny trainings")


def run(options: argparse.Namespace) -> int:
    """Run the study that is named, or list what there is.

    Raises:
        ConfigError, StudyError, DomainError: what is wrong with the input.
    """
    from freemesh_ray.api.run_study import begun, check, longer
    from freemesh_ray.api.run_study import run as run_study
    from freemesh_ray.studies.definition import load, shipped

    if options.study is None:
        say(table(["study", "trials", "compares"], [_row(load(name)) for name in shipped()], left=(0, 2)))
        return 0
    if options.add:
        study = longer(options.study, options.add, options.set, smoke=options.smoke)
    elif options.resume and not Path(options.study).is_file() and options.study not in shipped():
        study = begun(options.study, options.set, options.smoke).study()
    else:
        study = load(options.study, options.set, smoke=options.smoke)
    if options.dry_run:
        check(study)
        say(_trials(study, options.records))
        return 0

    try:
        result = run_study(
            study, callbacks=(), resume=options.resume or bool(options.add), note=say, records=options.records
        )
    except KeyboardInterrupt:
        sets = [word for setting in options.set for word in ("--set", setting)]
        again = ["study", options.study, *sets, *(["--smoke"] if options.smoke else []), "--resume"]
        note(f"`{shlex.join(['freemesh', *again])}` goes on from the last checkpoints")
        raise
    say(_closing(result, study))
    return 0


def _row(study: Study) -> list[str]:
    compared = ", ".join(study.variants) if study.variants else ", ".join(study.search.space if study.search else ())
    return [study.name, str(study.trainings()), compared]


def _trials(study: Study, places: Sequence[str]) -> str:
    """The trials, one a line, with what they differ in; those in records at these places are marked."""
    from freemesh_ray.config import dump, values
    from freemesh_ray.studies.runner import planned
    from freemesh_ray.studies.uptake import read

    recorded = read(places)

    folder, _, records = planned(study)
    common = dump(study.tree()["settings"]).rstrip() if study.tree()["settings"] else "the defaults"
    lines = [study.title, f"folder: {folder.path}", "all trials:", *(f"  {line}" for line in common.splitlines()), ""]
    if study.search:
        search = study.search
        seeds = ", ".join(map(str, study.seeds))
        lines.append(f"{search.trials} trials, {search.searcher}, {search.scheduler}, seeds {seeds}; drawn from")
        lines += [f"  {key}: {space.distribution} {list(space.values)}" for key, space in search.space.items()]
        if confirm := search.confirm:
            fresh = ", ".join(map(str, confirm.seeds))
            lines.append(f"then the best {confirm.best} and the default again on seeds {fresh}")
        return "\n".join(lines)
    rows = []
    for record in records:
        differs = ", ".join(f"{key}={value}" for key, value in values(study.variants[record.label]).items())
        run = Path(record.run).name
        status = "in records" if record.status == "pending" and run in recorded else record.status
        rows.append([record.name, run, status, differs or "-"])
    return "\n".join([*lines, table(["trial", "run", "status", "settings"], rows, left=(0, 1, 2, 3))])


def _closing(result: StudyResult, study: Study) -> str:
    """What came of it."""
    from freemesh_ray.policies.evaluation import metric, mode_and_figure

    by_status: dict[str, list[TrialResult]] = {}
    for trial in result.trials:
        by_status.setdefault(trial.status, []).append(trial)
    lines = [", ".join(f"{len(group)} {status}" for status, group in by_status.items())]
    lines += [f"failed: {trial.name}: {trial.error}" for trial in by_status.get("failed", [])]
    if result.best is not None:
        best = result.best
        mode, _ = mode_and_figure(study.metric)
        nothing = "" if best.figures[metric(mode, "completion_rate")] else ", but it completes no mesh"
        lines.append(
            f"best    {best.label}, seed {best.seed}: {study.metric} {best.figures[study.metric]:.3f}{nothing}"
        )
        lines.append(f"policy  {pasted(normpath(best.folder.policy))}")
    lines.append(f"report  {pasted(result.folder.report / 'report.md')}")
    tracking = study.settings_of_all()["tracking"]
    if tracking["enabled"]:
        shown = enumerate(browsing(tracking["uri"], result.page))
        lines += [f"{'' if i else 'compare':<7} {line}" for i, line in shown]
    return "\n".join(lines)
