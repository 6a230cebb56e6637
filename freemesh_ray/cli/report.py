"""``freemesh report``: its grammar and what it calls."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from freemesh_ray.cli.arguments import add_command, whole
from freemesh_ray.config.paths import Paths, shown
from freemesh_ray.formatting.terminal import note, paths, say
from freemesh_ray.report import EPISODES

EPILOG = """\
examples:
  freemesh report algorithms
  freemesh report algorithms --docs docs/studies      and its main parts as docs/studies/algorithms.md

Works while the study is under way, and says so.
"""


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    report = add_command(
        commands,
        "report",
        "a study's figure and table, with intervals",
        "Turn a study's trainings into the paper's figure and table: curves, intervals, comparisons.",
        EPILOG,
    )
    report.add_argument("study", metavar="NAME", help="of a study that `freemesh study` began")
    report.add_argument("--studies", default="studies", metavar="FOLDER", help="where the studies lie (studies)")
    report.add_argument("--out", metavar="FOLDER", help="where the report is written (STUDIES/NAME/report)")
    report.add_argument("--docs", metavar="FOLDER", help="write the main parts as NAME.md with pictures, too")
    report.add_argument("--episodes", type=whole(1, 1000), default=EPISODES, metavar="N",
                        help="of each policy on each domain, in either mode (%(default)s)")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Write the report, with a line on stderr for each policy, and print the files that were written.

    Raises:
        StudyError, ConfigError, OutputError: what is wrong with the input.
    """
    from freemesh_ray.report.report import write

    out, docs = (Path(folder) if folder else None for folder in (options.out, options.docs))
    folder = Paths.from_environment().home / options.studies / options.study
    path = write(folder, out=out, docs=docs, episodes=options.episodes, note=note)
    for file in [path, *sorted(other for other in path.parent.iterdir() if other != path)]:
        say(paths([shown(file)]))
    return 0
