"""The report of a study: read its results, compute, draw, write.

studies/NAME/report/report.md          to be read
                    report.html        the same as one page that needs nothing but itself
                    *.png, *.svg       its pictures
                    *.csv              their numbers
                    records.parquet    all results: `freemesh report --from` makes the rest of it anew
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from freemesh_ray.policies.evaluation import DETERMINISTIC
from freemesh_ray.records import parquet_file
from freemesh_ray.records.schema import FILE
from freemesh_ray.report import EPISODES, best_meshes, csv_files, html_page, pictures, ranked_draws, sections
from freemesh_ray.report.against_paper import paper_table
from freemesh_ray.report.expectations import expectations
from freemesh_ray.report.number_text import final
from freemesh_ray.report.outcomes import evidence, judged
from freemesh_ray.report.pairwise import all_pairs, pairs_to_show
from freemesh_ray.report.results import Results, TrialResult, read
from freemesh_ray.report.sections import Picture
from freemesh_ray.report.to_records import recorded
from freemesh_ray.report.transfer import Transfer, transfer
from freemesh_ray.report.transfer import recorded as recorded_transfer
from freemesh_ray.report.variants import return_threshold, variant_results
from freemesh_ray.statistics.profile import performance_profile
from freemesh_ray.storage.atomic import replacing

#: From where pictures are to the text's sections.
Writer = Callable[[Picture], list[str]]


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
        docs: a folder of documents: the report is DOCS/NAME/README.md there, with pictures, tables and records.
        episodes: of each policy on each domain, deterministic and again stochastic; >= 1.
        note: called with a line of progress.

    Returns:
        The path of report.md; tables, pictures and records lie beside it.

    Raises:
        StudyError, ConfigError: there is no such study, or its results cannot be read.
        OutputError: a place cannot be written to.
    """
    return write_results(read(folder), out or folder / "report", docs=docs, episodes=episodes, note=note)


def write_results(
    results: Results,
    out: Path,
    *,
    docs: Path | None = None,
    episodes: int = EPISODES,
    note: Callable[[str], None] = lambda line: None,
) -> Path:
    """Write the report of results, wherever they were read from; see `write`.

    Raises:
        OutputError: a place cannot be written to.
    """
    report = report_search if results.study.search else report_variants
    if results.records is not None:
        episodes = results.records.episodes
    writer, files = report(results, out, episodes, note)
    path = out / "report.md"
    text = _write(path, writer(_picture))
    html_page.write(path.with_suffix(".html"), text, out)
    if docs is not None:
        place = docs / results.study.name
        _write(place / "README.md", writer(_picture))
        for file in files:
            with replacing(place / file.name) as draft:
                draft.write_bytes(file.read_bytes())
    return path


def _picture(name: str, what: str) -> str:
    """A picture in the text: PNG, where its name does not say otherwise."""
    return f"![{what}]({name if name.endswith('.svg') else f'{name}.png'})"


def _write(path: Path, parts: Sequence[str]) -> str:
    text = "\n\n".join(part for part in parts if part) + "\n"
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")
    return text


def report_variants(
    results: Results, out: Path, episodes: int, note: Callable[[str], None]
) -> tuple[Writer, list[Path]]:
    """A study of variants: its tables, pictures and records, written to ``out``, and what writes its text."""
    study, variants = results.study, variant_results(results)
    used = [trial for each in variants for trial in each.used]
    evaluated = transferred(results, used, episodes, note)
    pairs, said = all_pairs(variants, evaluated), judged(evidence(study.expects, variants, evaluated))
    papers = results.records.paper_table if results.records else paper_table(variants, evaluated.policies)
    cut = best_meshes.of_best(variants, evaluated, study.domains)
    by = final(study.metric)
    files = [
        csv_files.curves(out / "curves.csv", variants),
        csv_files.finals(out / "final.csv", variants, return_threshold(variants)),
        csv_files.domains(out / "domains.csv", evaluated),
        csv_files.comparisons(out / "comparisons.csv", pairs),
        csv_files.expectations(out / "expectations.csv", said),
        pictures.curves(out, variants, study.title),
    ]
    if not results.preface:
        files.append(parquet_file.write(out / FILE, recorded(results, evaluated, cut, papers, episodes)))
    if evaluated.figures:
        files += profiles(out, results, evaluated)
    if shown := pairs_to_show(pairs):
        files.append(pictures.improvement(out, shown, by))
    drawn = best_meshes.draw(out, cut)
    files += [out / file for names in drawn.values() for file in names]

    def text(picture: Picture) -> list[str]:
        return [
            sections.opening(results),
            results.preface,
            expectations(said, by, bool(study.paper)) if said else "",
            sections.curves(variants, picture),
            f"## The paper's table\n\n{papers}" if papers else "",
            sections.domains(variants, evaluated, episodes, picture) if study.domains else "",
            best_meshes.section(drawn, by, picture),
            sections.pairs(shown, len(pairs), by, picture) if shown else "",
            sections.what_was_run(results, evaluated.commits.values()),
            sections.trials(results),
            sections.METHOD,
        ]

    return text, files


def transferred(results: Results, used: Sequence[TrialResult], episodes: int, note: Callable[[str], None]) -> Transfer:
    """The policies on the study's domains, or what records have of them."""
    if results.records is not None:
        return recorded_transfer(used, results.records)
    return transfer(used, results.study.domains, episodes, note)


def profiles(out: Path, results: Results, evaluated: Transfer) -> list[Path]:
    """The performance profile of every variant that has a policy, as numbers and picture."""
    scores = {label: evaluated.of(label, "score", DETERMINISTIC) for label in results.labels}
    found = {label: performance_profile(each, pictures.THRESHOLDS) for label, each in scores.items() if each.size}
    table = csv_files.profiles(out / "profile.csv", pictures.THRESHOLDS, found)
    return [table, pictures.profiles(out, found)]


def report_search(results: Results, out: Path, episodes: int, note: Callable[[str], None]) -> tuple[Writer, list[Path]]:
    """A search: its ranking, picture and records, written to ``out``, and what writes its text."""
    study, ranks = results.study, ranked_draws.ranking(results)
    files = [ranked_draws.write_csv(out / "trials.csv", ranks, study)]
    if again := ranked_draws.ranking(results, again=True):
        files.append(ranked_draws.write_csv(out / "confirmation.csv", again, study))
    files.append(parquet_file.write(out / FILE, recorded(results, Transfer([], {}, {}, {}), {}, "", episodes)))
    if ranks:
        files.append(ranked_draws.picture(out, ranks, study))

    def text(picture: Picture) -> list[str]:
        return [
            sections.opening(results),
            ranked_draws.section(ranks, picture, study),
            ranked_draws.confirmation(ranks, again, study),
            sections.what_was_run(results, []),
            sections.trials(results),
        ]

    return text, files
