"""The table of a batch."""

from __future__ import annotations

from collections.abc import Sequence

from freemesh_ray.batch.inputs import Job
from freemesh_ray.batch.outcome import Outcome
from freemesh_ray.formatting.table import table

HEADER = ("file", "quads", "eta", "worst", "irregular/least", "seconds", "")


def summary(rows: Sequence[tuple[Job, Outcome]]) -> str:
    """A line for each file, in the order in which they were given; what failed is told in the last column."""
    lines = [line(job, outcome) for job, outcome in sorted(rows, key=lambda row: row[0].number)]
    return table(HEADER, lines, left=(0, 6))


def line(job: Job, outcome: Outcome) -> tuple[str, ...]:
    """The cells of a file; of several meshes the sums, the mean of all elements and the worst."""
    told = "meshed before" if outcome.skipped else outcome.error.removeprefix(f"{job.source}: ")
    if not outcome.meshes:
        return (job.source, "-", "-", "-", "-", "-" if outcome.skipped else f"{outcome.seconds:.1f}", told)
    quads = sum(mesh["elements"] for mesh in outcome.meshes)
    eta = sum(mesh["elements"] * mesh["eta"] for mesh in outcome.meshes) / max(quads, 1)
    irregular, least = (sum(mesh[key] for mesh in outcome.meshes) for key in ("singularity", "singularity_least"))
    worst = min(mesh["eta_min"] for mesh in outcome.meshes)
    return (
        job.source, f"{quads:.0f}", f"{eta:.3f}", f"{worst:.3f}", f"{irregular:.0f}/{least:.0f}",
        f"{outcome.seconds:.1f}", told,
    )  # fmt: skip


def figures(outcome: Outcome) -> str:
    """A file's meshes in a few words."""
    cells = line(Job(0, "", ""), outcome)
    return f"{counted(int(cells[1]), 'quad')}, eta {cells[2]} (worst {cells[3]}), {cells[5]} s"


def counted(count: int, thing: str) -> str:
    """``1 file``, ``2 files``."""
    return f"{count} {thing}{'' if count == 1 else 's'}"
