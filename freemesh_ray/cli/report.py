"""``freemesh report``: its grammar and what it calls."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from envs.errors import FAILED
from freemesh_ray.cli.arguments import add_command, whole
from freemesh_ray.config.paths import Paths, shown
from freemesh_ray.formatting.terminal import note, paths, say
from freemesh_ray.report import EPISODES

EPILOG = """\
examples:
  freemesh report algorithms
  freemesh report algorithms --docs docs/studies      and its main parts as docs/studies/algorithms.md
  freemesh report --site docs/site                    all studies as a static site, with an index

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
    which = report.add_mutually_exclusive_group(required=True)
    which.add_argument("study", nargs="?", metavar="NAME", help="of a study that `freemesh study` began")
    which.add_argument("--site", metavar="FOLDER", help="of all studies: their reports as pages, and an index")
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

    if options.site:
        return run_site(options)
    out, docs = (Path(folder) if folder else None for folder in (options.out, options.docs))
    folder = Paths.from_environment().home / options.studies / options.study
    path = write(folder, out=out, docs=docs, episodes=options.episodes, note=note)
    for file in [path, *sorted(other for other in path.parent.iterdir() if other != path)]:
        say(paths([shown(file)]))
    tell_store(folder)
    return 0


def tell_store(folder: Path) -> None:
    """Describe the study in its tracking store by what the report says now, and print on stderr what shows it there."""
    from freemesh_ray.api.summary import describe

    for line in describe(folder):
        note(line)


def run_site(options: argparse.Namespace) -> int:
    """Write the site, print its pages, and on stderr what could not be read; 1 where there is such a study.

    Raises:
        StudyError, OutputError: there is no study, or the site cannot be written; or options do not go together.
    """
    from freemesh_ray.report.site import write
    from freemesh_ray.studies.study_folder import StudyError

    if options.out or options.docs:
        raise StudyError(f"{'--out' if options.out else '--docs'}: goes with a NAME, not with --site")
    site = write(
        Paths.from_environment().home / options.studies, Path(options.site), episodes=options.episodes, note=note
    )
    for path in [site.index, *site.pages.values()]:
        say(paths([shown(path)]))
    if site.unreadable:
        note(f"not readable, and listed in {shown(site.index)}: {paths(site.unreadable)}")
    return FAILED if site.unreadable else 0
