"""``freemesh report``: its grammar and what it calls."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from envs.errors import FAILED
from freemesh_ray.cli.arguments import add_command, whole
from freemesh_ray.config.paths import Paths, shown
from freemesh_ray.formatting.terminal import note, paths, say
from freemesh_ray.report import EPISODES

if TYPE_CHECKING:
    from freemesh_ray.report.results import Results

#: Where documents have the records of studies.
DOCUMENTS = "docs/studies"

EPILOG = """\
examples:
  freemesh report algorithms
  freemesh report algorithms --docs docs/studies      also as docs/studies/algorithms/README.md, with its records
  freemesh report --from docs/studies/algorithms/records.parquet
  freemesh report algorithms updates runs/default      their variants in one report
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
    which.add_argument(
        "study", nargs="*", default=[], metavar="NAME",
        help="of a study that `freemesh study` began; several are compared, each a name, or the path of records, of "
        "their folder, of a study's or of a run's folder",
    )  # fmt: skip
    which.add_argument("--from", dest="records_file", metavar="FILE", help="records.parquet of a report: nothing else")
    which.add_argument("--site", metavar="FOLDER", help="of all studies: their reports as pages, and an index")
    report.add_argument("--studies", default="studies", metavar="FOLDER", help="where the studies lie (studies)")
    report.add_argument("--records", metavar="FOLDER", help="of --site: where records lie beside them, as "
                        f"NAME/records.parquet ({DOCUMENTS}, if it is there)")  # fmt: skip
    report.add_argument("--out", metavar="FOLDER", help="where the report is written (STUDIES/NAME/report)")
    report.add_argument("--docs", metavar="FOLDER", help="write it as FOLDER/NAME/README.md, with all it needs, too")
    report.add_argument("--episodes", type=whole(1, 1000), metavar="N",
                        help=f"of each policy on each domain, either mode ({EPISODES}; of records theirs)")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Write the report, with a line on stderr for each policy, and print the files that were written.

    Raises:
        StudyError, ConfigError, RecordsError, OutputError: what is wrong with the input.
    """
    from freemesh_ray.report.one_study import write_results
    from freemesh_ray.report.results import from_records
    from freemesh_ray.report.several import together
    from freemesh_ray.report.sources import results_of
    from freemesh_ray.studies.study_folder import StudyError

    if options.site:
        return run_site(options)
    if options.records:
        raise StudyError("--records: goes with --site: here give --from FILE")
    studies = Paths.from_environment().home / options.studies
    if options.records_file:
        results = from_records(Path(options.records_file))
    elif len(options.study) == 1:
        results = results_of(options.study[0], studies)
    else:
        results = together([(given, results_of(given, studies)) for given in options.study])
    check_options(options, results)
    out = Path(options.out) if options.out else place_of(results, studies)
    docs = Path(options.docs) if options.docs else None
    path = write_results(results, out, docs=docs, episodes=options.episodes or EPISODES, note=note)
    for file in [path, *sorted(other for other in path.parent.iterdir() if other != path)]:
        say(paths([shown(file)]))
    if results.folder is not None and not results.preface:
        tell_store(results.folder)
    return 0


def check_options(options: argparse.Namespace, results: Results) -> None:
    """Refuse options that do not go with the results.

    Raises:
        StudyError: as said.
    """
    from freemesh_ray.studies.study_folder import StudyError

    if results.records is not None and options.episodes is not None:
        raise StudyError(f"--episodes: records have the figures of {results.records.episodes} episodes: leave it out")
    if results.preface and options.docs:
        raise StudyError("--docs: goes with one study: give --out for a comparison")
    if results.single:
        raise StudyError(f"{options.study[0]}: is the folder of one training: give two or more to compare")


def place_of(results: Results, studies: Path) -> Path:
    """Where a report goes that nobody named a place for.

    Raises:
        StudyError: a study of another origin lies there.
    """
    from freemesh_ray.studies.study_folder import StudyError, StudyFolder

    if results.folder is not None:
        return StudyFolder(results.folder).report
    folder = StudyFolder(studies / results.study.name)
    if folder.definition.is_file():
        raise StudyError(f"{folder.path}: is a study of that name: say with --out where this report goes")
    return folder.report


def tell_store(folder: Path) -> None:
    """Describe the study in its tracking store by what the report says now, and print on stderr what shows it there."""
    from freemesh_ray.api.study_description import describe

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
    home = Paths.from_environment().home
    records = Path(options.records) if options.records else home / DOCUMENTS
    episodes = options.episodes or EPISODES
    site = write(home / options.studies, Path(options.site), records=records, episodes=episodes, note=note)
    for path in [site.index, *site.pages.values()]:
        say(paths([shown(path)]))
    if site.unreadable:
        note(f"not readable, and listed in {shown(site.index)}: {paths(site.unreadable)}")
    return FAILED if site.unreadable else 0
