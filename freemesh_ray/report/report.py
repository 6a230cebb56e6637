"""The report of a study: read its results, compute, draw, write.

studies/NAME/report/report.md          to be read
                    *.png, *.svg       its pictures
                    *.csv              their numbers
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from freemesh_ray.formatting.figures import final
from freemesh_ray.report import numbers, pictures, search, sections
from freemesh_ray.report.comparisons import compared, outcomes, telling
from freemesh_ray.report.learning import halfway, learnt
from freemesh_ray.report.paper_table import paper_table
from freemesh_ray.report.results import Results, read
from freemesh_ray.report.sections import Picture
from freemesh_ray.report.transfer import Transfer, transfer
from freemesh_ray.statistics.profile import performance_profile
from freemesh_ray.storage.atomic import replacing

#: Of the evaluation of every policy on every domain, as in the paper.
EPISODES = 10

#: From a study, and where pictures are, to the text's sections: those that matter, then the rest.
Writer = Callable[[Picture], tuple[list[str], list[str]]]


def write(
    folder: Path,
    *,
    out: Path | None = None,
    docs: Path | None = None,
    episodes: int = EPISODES,
    note: Callable[[str], None] = lambda line: None,
) -> Path:
    """Write the report of a finished, or partly finished, study.

    Args:
        folder: of the study, with study.yaml and trials.json.
        out: where the report goes; ``folder``/report by default.
        docs: a second place for the main parts as NAME.md with its pictures, to be part of other documents.
        episodes: of each policy on each domain, deterministic and again stochastic; >= 1.
        note: called with a line of progress.

    Returns:
        The path of report.md; tables and pictures lie beside it.

    Raises:
        ResultsError: there is no such study, or its results cannot be read.
        OutputError: a place cannot be written to.
    """
    results = read(folder)
    out = out or folder / "report"
    make = searched if results.search else trained
    writer, drawn = make(results, out, episodes, note)
    main, rest = writer(lambda name, what: f"![{what}]({name}.png)")
    path = out / "report.md"
    _write(path, [*main, *rest])
    if docs is not None:
        main, _ = writer(lambda name, what: f"![{what}]({results.name}-{name}.png)")
        _write(docs / f"{results.name}.md", main)
        for picture in drawn:
            with replacing(docs / f"{results.name}-{picture.name}") as draft:
                draft.write_bytes(picture.read_bytes())
    return path


def _write(path: Path, parts: Sequence[str]) -> None:
    with replacing(path) as draft:
        draft.write_text("\n\n".join(part for part in parts if part) + "\n", encoding="utf-8")


def trained(results: Results, out: Path, episodes: int, note: Callable[[str], None]) -> tuple[Writer, list[Path]]:
    """A study of variants: its tables and pictures, written to ``out``, and what writes its text."""
    variants = learnt(results)
    moved = transfer([trial for each in variants for trial in each.used], results.domains, episodes, note)
    found, said = compared(variants, moved), outcomes(results.expects, variants, moved)
    printed = paper_table(variants, moved.policies)
    numbers.curves(out / "curves.csv", variants)
    numbers.finals(out / "final.csv", variants, halfway(variants))
    numbers.domains(out / "domains.csv", moved)
    numbers.comparisons(out / "comparisons.csv", found)
    drawn = [pictures.curves(out, variants, results.title)]
    if moved.figures:
        drawn.append(profiles(out, results, moved))
    if shown := telling(found):
        drawn.append(pictures.improvement(out, shown, final(results.metric)))

    def text(picture: Picture) -> tuple[list[str], list[str]]:
        main = [
            sections.opening(results),
            sections.expectations(said, final(results.metric)) if said else "",
            sections.curves(variants, picture),
            f"## The paper's table\n\n{printed}" if printed else "",
            sections.domains(variants, moved, episodes, picture) if results.domains else "",
            sections.pairs(shown, len(found), final(results.metric), picture) if shown else "",
            sections.what_was_run(results, moved.policies),
        ]
        return main, [sections.trials(results), sections.METHOD]

    return text, drawn


def profiles(out: Path, results: Results, moved: Transfer) -> Path:
    """The performance profile of every variant that has a policy, as picture and numbers."""
    scores = {label: moved.of(label, "score", "deterministic") for label in results.variants}
    found = {label: performance_profile(each, pictures.THRESHOLDS) for label, each in scores.items() if each.size}
    numbers.profiles(out / "profile.csv", pictures.THRESHOLDS, found)
    return pictures.profiles(out, found)


def searched(results: Results, out: Path, episodes: int, note: Callable[[str], None]) -> tuple[Writer, list[Path]]:
    """A search: its ranking and picture, written to ``out``, and what writes its text."""
    found = search.ranked(results)
    search.table(out / "trials.csv", found, results)
    drawn = [search.picture(out, found, results)] if search.drawn(found) else []

    def text(picture: Picture) -> tuple[list[str], list[str]]:
        main = [sections.opening(results), search.section(found, picture, results), sections.what_was_run(results, {})]
        return main, [sections.trials(results)]

    return text, drawn
