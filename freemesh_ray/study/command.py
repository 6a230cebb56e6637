"""``freemesh study``: its grammar and what it calls."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from freemesh_ray.table import duration, table

if TYPE_CHECKING:
    from freemesh_ray.study.definition import Study
    from freemesh_ray.study.folder import Entry
    from freemesh_ray.study.running import Studied

EPILOG = """\
examples:
  freemesh study algorithms --dry-run             the trials, and nothing else
  freemesh study algorithms --smoke               the whole path in about a minute
  freemesh study algorithms                       run it; Ctrl-C stops it, --resume goes on
  freemesh study mine.yaml --set budget.env_steps=1.2e6
  freemesh report algorithms                      its figures and tables

A study is one YAML file; those that ship are in tune_configs. Trials run side by side, as many as the machine has
cores for. A training that another study has done already, with the same settings, seed and commit, is not repeated.
"""


def grammar(commands: Any) -> None:
    """Add the command to the parser's."""
    study = commands.add_parser(
        "study",
        help="run a study of many trainings",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Run a study on Ray Tune, track it in MLflow and report on it.",
        epilog=EPILOG,
    )
    study.add_argument("study", nargs="?", metavar="STUDY", help="a name (without one: the list), or a YAML file")
    study.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="a setting of all trials; repeatable"
    )
    study.add_argument("--resume", action="store_true", help="go on where it stopped, if it was begun")
    study.add_argument("--dry-run", action="store_true", help="print the trials and stop")
    study.add_argument("--smoke", action="store_true", help="the whole path with tiny trainings")


def run(options: argparse.Namespace) -> int:
    """Run the study that is named, or list what there is.

    Raises:
        ConfigError, RunError, DomainError: what is wrong with the input.
    """
    from freemesh_ray.study.definition import load, shipped

    if options.study is None:
        print(table(["study", "trials", "compares"], [_row(load(name)) for name in shipped()]))
        return 0
    study = load(options.study, options.set, smoke=options.smoke)
    _check(study)
    if options.dry_run:
        print(_trials(study))
        return 0

    from freemesh_ray.local_ray import local_ray

    with local_ray(study.settings_of_all()["runners"]["count"]):
        from freemesh_ray.algorithms.build import build
        from freemesh_ray.report.report import write
        from freemesh_ray.study.running import run as run_study

        print(_opening(study), flush=True)
        try:
            studied = run_study(study, resume=options.resume, make=build, report=write)
        except KeyboardInterrupt:
            print(f"interrupted; `freemesh study {options.study} --resume` goes on from the last checkpoints", file=sys.stderr)
            raise
    print(_closing(studied, study))
    return 0
