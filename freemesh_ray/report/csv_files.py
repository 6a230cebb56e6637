"""The report's CSV files: the numbers of every table and picture, unrounded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from envs.types import Floats
from freemesh_ray.formatting.csv_text import csv_text
from freemesh_ray.report.outcomes import Outcome
from freemesh_ray.report.pairwise import Comparison
from freemesh_ray.report.transfer import Transfer
from freemesh_ray.report.variants import COMPLETED, FINALS, VariantResult
from freemesh_ray.statistics.bootstrap import Interval
from freemesh_ray.storage.atomic import replacing


def write(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    """Write a table; see `formatting.csv_text`.

    Raises:
        OutputError: the place cannot be written to.
    """
    with replacing(path) as draft:
        draft.write_text(csv_text(header, rows), encoding="utf-8", newline="")
    return path


def curves(path: Path, variants: Sequence[VariantResult]) -> Path:
    """Write every curve: the interquartile mean with its interval at every step."""
    rows = [
        [variant.label, metric, len(band.seeds), *point]
        for variant in variants
        for metric, band in variant.bands.items()
        for point in zip(band.steps.tolist(), *(line.tolist() for line in band.iqm), strict=True)
    ]
    return write(path, ["variant", "figure", "seeds", "env_steps", "iqm", "low", "high"], rows)


def finals(path: Path, variants: Sequence[VariantResult], threshold: float) -> Path:
    """Write every trial's final figures and when it reached the threshold, and a completion rate."""
    rows = []
    for variant in variants:
        _, reached = variant.steps_to(threshold)
        areas, completed = variant.mean_over_training().tolist(), variant.to_completion()
        for i, trial in enumerate(variant.used):
            last = [float(variant.finals[metric][i]) for metric in FINALS]
            rows.append(
                [variant.label, trial.seed, trial.status, trial.env_steps, *last, areas[i], reached[i], *completed[i]]
            )
    header = ["variant", "seed", "status", "env_steps", *FINALS, "mean_return_over_training", f"steps_to_{threshold:g}",
              f"steps_to_completion_{COMPLETED:g}", f"seconds_to_completion_{COMPLETED:g}"]  # fmt: skip
    return write(path, header, rows)


def domains(path: Path, transfer: Transfer) -> Path:
    """Write every policy's figures on every domain."""
    names = list(next(iter(transfer.figures.values()), {}))
    rows = [[*key, *(figures[name] for name in names)] for key, figures in transfer.figures.items()]
    return write(path, ["variant", "seed", "domain", "mode", *names], rows)


def profiles(path: Path, thresholds: Floats, found: Mapping[str, Interval]) -> Path:
    """Write every variant's performance profile."""
    rows = [
        [label, *point]
        for label, profile in found.items()
        for point in zip(thresholds.tolist(), *(line.tolist() for line in profile), strict=True)
    ]
    return write(path, ["variant", "score", "share_above", "low", "high"], rows)


def comparisons(path: Path, found: Sequence[Comparison]) -> Path:
    """Write every pair of variants."""
    nothing = (None, None, None)
    rows = [
        [each.x, each.y, *each.runs, *map(float, each.by_final), each.p_value, each.p_corrected,
         *(nothing if each.by_score is None else map(float, each.by_score))]
        for each in found
    ]  # fmt: skip
    header = ["x", "y", "runs_x", "runs_y", "by_final", "by_final_low", "by_final_high", "p_value", "p_corrected",
              "by_score", "by_score_low", "by_score_high"]  # fmt: skip
    return write(path, header, rows)


def expectations(path: Path, outcomes: Sequence[Outcome]) -> Path:
    """Write every expectation and what came of it; the difference is that of the means, x less y."""
    rows = []
    for outcome in outcomes:
        e = outcome.evidence
        measured: list[float | None] = [None] * 9
        if e.comparison is not None:
            measured = [*map(float, e.comparison.by_final), *map(float, e.difference.interval), e.difference.margin,
                        *((outcome.p_value, outcome.p_corrected) if e.complete else (None, None))]  # fmt: skip
        rows.append([str(e.expectation), len(e.x), len(e.y), *measured, outcome.verdict, outcome.seeds])
    header = ["expected", "runs_x", "runs_y", "by_final", "by_final_low", "by_final_high",
              "difference", "difference_low", "difference_high", "margin", "p_value", "p_corrected",
              "verdict", "seeds_to_decide"]  # fmt: skip
    return write(path, header, rows)
