"""A static site of all studies: an index, and each study's report as a page.

SITE/index.html           every study: what was studied, its verdicts, seeds, steps and date
     studies/NAME.html    its report
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

from envs.errors import UserError
from envs.printable import printable
from freemesh_ray.formatting.markdown import Markdown, escaped
from freemesh_ray.formatting.table import markdown
from freemesh_ray.records.schema import FILE
from freemesh_ray.report import EPISODES, html_page
from freemesh_ray.report.best_meshes import described
from freemesh_ray.report.number_text import count, span
from freemesh_ray.report.one_study import write_results
from freemesh_ray.report.results import Results, from_records, read
from freemesh_ray.report.to_records import newest
from freemesh_ray.statistics.verdict import Verdict
from freemesh_ray.storage.atomic import OutputError, replacing
from freemesh_ray.studies.study_folder import StudyError, StudyFolder

#: Where a site's pages of studies lie.
PAGES = "studies"
#: Files of which a study's folder has one at least.
BEGUN = ("study.yaml", "trials.json")


@dataclass(frozen=True)
class Site:
    """What was made.

    Attributes:
        index: path of the first page.
        pages: study -> path of its page.
        unreadable: study -> why it has none.
    """

    index: Path
    pages: Mapping[str, Path]
    unreadable: Mapping[str, str]


def write(
    studies: Path,
    site: Path,
    *,
    records: Path | None = None,
    episodes: int = EPISODES,
    note: Callable[[str], None] = lambda line: None,
) -> Site:
    """Write the report of every study, and the site of all; pages of studies that are gone are removed, nothing else.

    Args:
        studies: folder of the studies.
        site: folder of the site; made where it is missing.
        records: folder of documents with records of studies, NAME/records.parquet; of two of a name the study counts.
        episodes: of each policy on each domain, see `report.write`.
        note: called with a line of progress.

    Raises:
        StudyError: there is no study.
        OutputError: a place of the site cannot be written to, or holds a page that is not the site's.
    """
    own = {path.name: path for path in _entries(studies) if any((path / name).exists() for name in BEGUN)}
    found = {path.name: path / FILE for path in _entries(records) if (path / FILE).exists()} if records else {}
    places = dict(sorted({**found, **own}.items()))
    if not places:
        raise StudyError(f"{studies}: no study in it: `freemesh study NAME` begins one")
    index, pages = site / "index.html", {name: site / PAGES / f"{name}.html" for name in places}
    for path, name in [(index, ""), *((path, name) for name, path in pages.items())]:
        if path.exists() and not _own(path, name):
            raise OutputError(f"{path}: is not a page of this site: move it, or name another folder")
    rows: list[list[str]] = []
    unreadable: dict[str, str] = {}
    for name, place in places.items():

        def told(line: str, of: str = name) -> None:
            note(f"{of}: {line}")

        try:
            line, page = page_of(name, place, episodes, told)
        except UserError as error:
            above = place.parent if name in own else place.parents[1]
            unreadable[name] = str(error).replace(f"{above}/", "").replace(str(above), above.name)
            told(unreadable[name])
            continue
        _write(pages[name], page)
        rows.append(line)
    made = {name: path for name, path in pages.items() if name not in unreadable}
    _write(index, html_page.page(text_of_index(rows, unreadable), site, generator=_generator(""), layout="index"))
    for path in _entries(site / PAGES):
        if path.suffix == ".html" and path.stem not in made and _own(path, path.stem):
            path.unlink()
    return Site(index, made, unreadable)


def page_of(name: str, place: Path, episodes: int, note: Callable[[str], None]) -> tuple[list[str], str]:
    """A study's line of the index and its page.

    Args:
        name: of the page.
        place: folder of a study, whose report is written into it, or a records file.
        episodes, note: see `write`.

    Raises:
        UserError: it cannot be read, or its report cannot be written.
    """
    with ExitStack() as stack:
        if place.is_dir():
            if not (definition := StudyFolder(place).definition).is_file():
                raise StudyError(f"{definition}: no such file")
            results, out = read(place), StudyFolder(place).report
        else:
            results, out = from_records(place), Path(stack.enter_context(TemporaryDirectory(prefix="freemesh-")))
        report = write_results(results, out, episodes=episodes, note=note)
        text = report.read_text(encoding="utf-8")
        page = html_page.page(text, out, generator=_generator(name), home="../index.html")
        return row(results, out, f"{PAGES}/{quote(name)}.html", date(results, place)), page


def text_of_index(rows: Sequence[Sequence[str]], unreadable: Mapping[str, str]) -> str:
    """The first page, in Markdown."""
    parts = ["# Studies"]
    if rows:
        parts.append(f"{count(len(rows), 'report')}; newest results of {max(line[-1] for line in rows)}.")
        parts.append(markdown(["study", "what was studied", "verdicts", "seeds", "env steps", "results of"], rows))
    if unreadable:
        told = [f"- {escaped(why if why.startswith(name) else f'{name}: {why}')}" for name, why in unreadable.items()]
        parts += ["## Not readable", "\n".join(told)]
    return "\n\n".join(parts) + "\n"


def row(results: Results, report: Path, address: str, day: str) -> list[str]:
    """A study's line of the index: of its report's folder, the address of its page and its day."""
    study, trials = results.study, results.trials
    seeds = len({trial.seed for trial in trials})
    steps = [trial.env_steps for trial in trials if trial.finished] or [trial.env_steps for trial in trials]
    return [
        Markdown(f"[{described(study.title)}](<{address}>)"),
        studied(results),
        verdicts(results, report),
        str(seeds),
        span(min(steps) // 1000, max(steps) // 1000, ",d") + "k",
        day,
    ]


def studied(results: Results) -> str:
    """What a study compares, and on what."""
    study = results.study
    if study.search:
        told = f"search over {', '.join(study.search.space)}: {count(len(results.labels), 'draw')}"
    else:
        told = f"{count(len(results.labels), 'variant')}: {', '.join(results.labels)}"
    return f"{told}; on {', '.join(study.domains)}" if study.domains else told


def verdicts(results: Results, report: Path) -> str:
    """How many expectations got each verdict, as the report that was just written has them."""
    found: list[str] = []
    if results.study.expects:
        with open(report / "expectations.csv", encoding="utf-8", newline="") as file:
            found = [line["verdict"] for line in csv.DictReader(file)]
    tally = Counter(found)
    told = ", ".join(f"{tally[said]} {said}" for said in Verdict if tally[said]) or "-"
    if not results.unfinished:
        return told
    over = len(results.trials) - len(results.unfinished)
    return f"{told}; not finished yet: {over} of {count(len(results.trials), 'trial')}"


def date(results: Results, place: Path) -> str:
    """The day of the newest result, in UTC: of a study's folder, or as its records say."""
    if results.records is not None:
        return results.records.date or "-"
    known = newest(results)
    listed = StudyFolder(place).trials.stat().st_mtime
    return max(known, datetime.fromtimestamp(listed, UTC).strftime("%Y-%m-%d"))


def _generator(name: str) -> str:
    """What a page of the site says that it was made by; empty for the index."""
    return f"{html_page.GENERATOR} --site, page {printable(name)}" if name else f"{html_page.GENERATOR} --site"


def _own(path: Path, name: str) -> bool:
    """Whether the page at ``path`` is the site's of that name: what else lies there is somebody's."""
    if path.is_symlink() or not path.is_file():
        return False
    with open(path, encoding="utf-8", errors="replace") as file:
        return f'<meta name="generator" content="{escape(_generator(name))}">' in file.read(4096)


def _entries(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.is_dir() else []


def _write(path: Path, text: str) -> None:
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")
