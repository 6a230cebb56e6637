"""The report of a study: read its results, compute, draw, write.

studies/NAME/report/report.md          to be read
                    report.html        the same as one page that needs nothing but itself
                    *.png, *.svg       its pictures
                    *.csv              their numbers
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from freemesh_ray.policies.evaluation import DETERMINISTIC
from freemesh_ray.report import EPISODES, csv_files, html_page, meshes, pictures, search, sections
from freemesh_ray.report.against_paper import paper_table
from freemesh_ray.report.comparisons import all_pairs, pairs_to_show
from freemesh_ray.report.expectations import expectations
from freemesh_ray.report.formats import final
from freemesh_ray.report.outcomes import evidence, judged
from freemesh_ray.report.results import Results, read
from freemesh_ray.report.sections import Picture
from freemesh_ray.report.transfer import Transfer, transfer
from freemesh_ray.report.variants import return_threshold, variant_results
from freemesh_ray.statistics.profile import performance_profile
from freemesh_ray.storage.atomic import replacing

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
        StudyError, ConfigError: there is no such study, or its results cannot be read.
        OutputError: a place cannot be written to.
    """
    results = read(folder)
    out = out or folder / "report"
    report = report_search if results.study.search else report_variants
    writer, drawn = report(results, out, episodes, note)
    main, rest = writer(_pictures_at(""))
    path = out / "report.md"
    text = _write(path, [*main, *rest])
    html_page.write(path.with_suffix(".html"), text, out)
    if docs is not None:
        main, _ = writer(_pictures_at(f"{results.study.name}-"))
        _write(docs / f"{results.study.name}.md", main)
        for picture in drawn:
            with replacing(docs / f"{results.study.name}-{picture.name}") as draft:
                draft.write_bytes(picture.read_bytes())
    return path


def _pictures_at(prefix: str) -> Picture:
    """Places of pictures whose names begin with ``prefix``: PNG, where a name does not say otherwise."""
    return lambda name, what: f"![{what}]({prefix}{name if name.endswith('.svg') else f'{name}.png'})"


def _write(path: Path, parts: Sequence[str]) -> str:
    text = "\n\n".join(part for part in parts if part) + "\n"
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")
    return text


def report_variants(
    results: Results, out: Path, episodes: int, note: Callable[[str], None]
) -> tuple[Writer, list[Path]]:
    """A study of variants: its tables and pictures, written to ``out``, and what writes its text."""
    study, variants = results.study, variant_results(results)
    evaluated = transfer([trial for each in variants for trial in each.used], study.domains, episodes, note)
    pairs, said = all_pairs(variants, evaluated), judged(evidence(study.expects, variants, evaluated))
    papers = paper_table(variants, evaluated.policies)
    by = final(study.metric)
    csv_files.curves(out / "curves.csv", variants)
    csv_files.finals(out / "final.csv", variants, return_threshold(variants))
    csv_files.domains(out / "domains.csv", evaluated)
    csv_files.comparisons(out / "comparisons.csv", pairs)
    csv_files.expectations(out / "expectations.csv", said)
    drawn = [pictures.curves(out, variants, study.title)]
    if evaluated.figures:
        drawn.append(profiles(out, results, evaluated))
    if shown := pairs_to_show(pairs):
        drawn.append(pictures.improvement(out, shown, by))
    cut = meshes.draw(out, variants, evaluated, study.domains)
    drawn += [out / file for files in cut.values() for file in files]

    def text(picture: Picture) -> tuple[list[str], list[str]]:
        main = [
            sections.opening(results),
            expectations(said, by, bool(study.paper)) if said else "",
            sections.curves(variants, picture),
            f"## The paper's table\n\n{papers}" if papers else "",
            sections.domains(variants, evaluated, episodes, picture) if study.domains else "",
            meshes.section(cut, by, picture),
            sections.pairs(shown, len(pairs), by, picture) if shown else "",
            sections.what_was_run(results, evaluated.policies),
        ]
        return main, [sections.trials(results), sections.METHOD]

    return text, drawn


def profiles(out: Path, results: Results, evaluated: Transfer) -> Path:
    """The performance profile of every variant that has a policy, as picture and numbers."""
    scores = {label: evaluated.of(label, "score", DETERMINISTIC) for label in results.labels}
    found = {label: performance_profile(each, pictures.THRESHOLDS) for label, each in scores.items() if each.size}
    csv_files.profiles(out / "profile.csv", pictures.THRESHOLDS, found)
    return pictures.profiles(out, found)


def report_search(results: Results, out: Path, episodes: int, note: Callable[[str], None]) -> tuple[Writer, list[Path]]:
    """A search: its ranking and picture, written to ``out``, and what writes its text."""
    study, ranks = results.study, search.ranking(results)
    search.write_csv(out / "trials.csv", ranks, study)
    if again := search.ranking(results, again=True):
        search.write_csv(out / "confirmation.csv", again, study)
    drawn = [search.picture(out, ranks, study)] if ranks else []

    def text(picture: Picture) -> tuple[list[str], list[str]]:
        main = [
            sections.opening(results),
            search.section(ranks, picture, study),
            search.confirmation(ranks, again, study),
            sections.what_was_run(results, {}),
        ]
        return main, [sections.trials(results)]

    return text, drawn
