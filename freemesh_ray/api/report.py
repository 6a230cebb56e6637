"""A study's report, and what the tracking store tells of the study: written at its end, and by ``freemesh report``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from freemesh_ray.report import EPISODES
from freemesh_ray.report.report import write
from freemesh_ray.report.summary import StudySummary, summary
from freemesh_ray.studies.study_folder import StudyFolder
from freemesh_ray.tracking import MLflowRun, Summary, VariantSummary, browsing, summarise

#: Where the report's files are among a study's artifacts.
BELOW = "report"


def at_end(folder: Path, run: MLflowRun) -> None:
    """Write the report of a study that comes to its end, and describe its run.

    Raises:
        StudyError, ConfigError, OutputError: as `freemesh_ray.report.report.write`.
    """
    write(folder)
    run.summarise(told(summary(folder), StudyFolder(folder).study().name))


def anew(
    folder: Path,
    *,
    out: Path | None = None,
    docs: Path | None = None,
    episodes: int = EPISODES,
    note: Callable[[str], None] = lambda line: None,
) -> tuple[Path, list[str]]:
    """Write the report of a study, and describe its run where it was tracked.

    Args:
        folder, out, docs, episodes, note: see `freemesh_ray.report.report.write`.

    Returns:
        The path of report.md, and what shows the study in its store (`browsing`); empty where it was not delivered.

    Raises:
        StudyError, ConfigError, OutputError: as there.
    """
    path = write(folder, out=out, docs=docs, episodes=episodes, note=note)
    study = StudyFolder(folder).study()
    tracking = study.settings_of_all()["tracking"]
    if not tracking["enabled"]:
        return path, []
    files: Sequence[Path] = sorted(StudyFolder(folder).report.iterdir()) if out is None else ()
    found = told(summary(folder), study.name)
    uri, experiment = tracking["uri"], tracking["experiment"]
    page = summarise(folder, found, uri=uri, experiment=experiment, artifacts=files, below=BELOW)
    return path, browsing(uri, page) if page else []


def told(found: StudySummary, name: str) -> Summary:
    """A summary as the store takes it."""
    variants = {
        label: VariantSummary(each.colour, each.settings, each.step, each.figures, each.curves)
        for label, each in found.variants.items()
    }
    charts = {"curves": found.curves, "seeds": found.seeds, "finals": found.finals}
    return Summary(found.text, found.step, found.figures, variants, charts, {"study": name})
