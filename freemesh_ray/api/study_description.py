"""What the tracking store tells of a study as a whole: with its report, at its end and by ``freemesh report``."""

from __future__ import annotations

from pathlib import Path

from freemesh_ray.report.one_study import write
from freemesh_ray.report.overview import StudySummary, summary
from freemesh_ray.studies.study_folder import StudyFolder
from freemesh_ray.tracking import MLflowRun, Summary, VariantSummary, browsing, summarise

#: Where the report's files are among a study's artifacts.
BELOW = "report"


def at_end(folder: Path, run: MLflowRun) -> None:
    """Write the report of a study that comes to its end, and describe its run.

    Raises:
        StudyError, ConfigError, OutputError: as `freemesh_ray.report.one_study.write`.
    """
    write(folder)
    run.summarise(told(summary(folder), StudyFolder(folder).study().name))


def describe(folder: Path) -> list[str]:
    """Describe the run of a study whose report was written anew, where it was tracked, and upload the report.

    Args:
        folder: of the study.

    Returns:
        What shows the study in its store (`browsing`); empty where the store did not get it.

    Raises:
        StudyError, ConfigError: there is no such study, or its results cannot be read.
    """
    place = StudyFolder(folder)
    study = place.study()
    tracking = study.settings_of_all()["tracking"]
    if not tracking["enabled"]:
        return []
    files = sorted(place.report.iterdir()) if place.report.is_dir() else []
    page = summarise(
        folder, told(summary(folder), study.name), uri=tracking["uri"], experiment=tracking["experiment"],
        artifacts=files, below=BELOW,
    )  # fmt: skip
    return browsing(tracking["uri"], page) if page else []


def told(found: StudySummary, name: str) -> Summary:
    """A summary of the study ``name`` as the store takes it."""
    variants = {
        label: VariantSummary(each.colour, each.settings, each.step, each.figures, each.curves)
        for label, each in found.variants.items()
    }
    charts = {"curves": found.curves, "seeds": found.seeds, "finals": found.finals}
    return Summary(found.text, found.step, found.figures, variants, charts, {"study": name})
