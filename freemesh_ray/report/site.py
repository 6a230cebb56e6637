"""A static site of all studies: an index, and each study's report as a page.

SITE/index.html           every study: what was studied, its verdicts, seeds, steps and date
     studies/NAME.html    its report
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from urllib.parse import quote

from envs.errors import UserError
from envs.printable import printable
from freemesh_ray.formatting.markdown import Markdown, escaped
from freemesh_ray.formatting.table import markdown
from freemesh_ray.report import EPISODES, html_page
from freemesh_ray.report.formats import count, span
from freemesh_ray.report.meshes import described
from freemesh_ray.report.report import write as write_report
from freemesh_ray.report.results import Results, read
from freemesh_ray.statistics.verdict import Verdict
from freemesh_ray.storage.atomic import OutputError, replacing
from freemesh_ray.studies.study_folder import StudyError, StudyFolder

#: Where a site's pages of studies lie.
PAGES = "studies"


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
    studies: Path, site: Path, *, episodes: int = EPISODES, note: Callable[[str], None] = lambda line: None
) -> Site:
    """Write the report of every study, and the site of all; pages of studies that are gone are removed, nothing else.

    Args:
        studies: folder of the studies.
        site: folder of the site; made where it is missing.
        episodes: of each policy on each domain, see `report.write`.
        note: called with a line of progress.

    Raises:
        StudyError: there is no study.
        OutputError: a place of the site cannot be written to, or holds a page that is not the site's.
    """
    names = sorted(
        path.name for path in _entries(studies) if any((path / name).exists() for name in ("study.yaml", "trials.json"))
    )
    if not names:
        raise StudyError(f"{studies}: no study in it: `freemesh study NAME` begins one")
    index, pages = site / "index.html", {name: site / PAGES / f"{name}.html" for name in names}
    for path, name in [(index, ""), *((path, name) for name, path in pages.items())]:
        if path.exists() and not _own(path, name):
            raise OutputError(f"{path}: is not a page of this site: move it, or name another folder")
    rows: list[list[str]] = []
    unreadable: dict[str, str] = {}
    for name in names:

        def told(line: str, of: str = name) -> None:
            note(f"{of}: {line}")

        try:
            if not (definition := StudyFolder(studies / name).definition).is_file():
                raise StudyError(f"{definition}: no such file")
            results = read(studies / name)
            report = write_report(studies / name, episodes=episodes, note=told)
            text = report.read_text(encoding="utf-8")
            page = html_page.page(text, report.parent, generator=_generator(name), home="../index.html")
        except UserError as error:
            unreadable[name] = str(error).replace(f"{studies}/", "").replace(str(studies), studies.name)
            told(unreadable[name])
            continue
        _write(pages[name], page)
        rows.append(row(results, studies / name, f"{PAGES}/{quote(name)}.html"))
    made = {name: path for name, path in pages.items() if name not in unreadable}
    _write(index, html_page.page(text_of_index(rows, unreadable), site, generator=_generator(""), layout="index"))
    for path in _entries(site / PAGES):
        if path.suffix == ".html" and path.stem not in made and _own(path, path.stem):
            path.unlink()
    return Site(index, made, unreadable)


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


def row(results: Results, folder: Path, address: str) -> list[str]:
    """A study's line of the index."""
    study, trials = results.study, results.trials
    seeds = len({trial.seed for trial in trials})
    steps = [trial.env_steps for trial in trials if trial.finished] or [trial.env_steps for trial in trials]
    return [
        Markdown(f"[{described(study.title)}](<{address}>)"),
        studied(results),
        verdicts(results, folder),
        str(seeds),
        span(min(steps) // 1000, max(steps) // 1000, ",d") + "k",
        date(results, folder),
    ]


def studied(results: Results) -> str:
    """What a study compares, and on what."""
    study = results.study
    if study.search:
        told = f"search over {', '.join(study.search.space)}: {count(len(results.labels), 'draw')}"
    else:
        told = f"{count(len(results.labels), 'variant')}: {', '.join(results.labels)}"
    return f"{told}; on {', '.join(study.domains)}" if study.domains else told


def verdicts(results: Results, folder: Path) -> str:
    """How many expectations got each verdict, as the report that was just written has them."""
    found: list[str] = []
    if results.study.expects:
        with open(StudyFolder(folder).report / "expectations.csv", encoding="utf-8", newline="") as file:
            found = [line["verdict"] for line in csv.DictReader(file)]
    tally = Counter(found)
    told = ", ".join(f"{tally[said]} {said}" for said in Verdict if tally[said]) or "-"
    if not results.unfinished:
        return told
    over = len(results.trials) - len(results.unfinished)
    return f"{told}; not finished yet: {over} of {count(len(results.trials), 'trial')}"


def date(results: Results, folder: Path) -> str:
    """The day of the newest result, in UTC."""
    files = [StudyFolder(folder).trials, *(trial.policy.with_name("evaluations.jsonl") for trial in results.trials)]
    newest = max((path.stat().st_mtime for path in files if path.is_file()), default=0.0)
    return datetime.fromtimestamp(newest, UTC).strftime("%Y-%m-%d")


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
