"""The report's pictures, each as PNG and SVG."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from envs.types import Floats
from freemesh_ray.plots import Pair, Panel, draw_bands, draw_improvements
from freemesh_ray.plots.page import SUFFIXES, save
from freemesh_ray.policies.evaluation import COMPLETION, RETURN
from freemesh_ray.report.pairwise import Comparison
from freemesh_ray.report.variants import VariantResult
from freemesh_ray.statistics.bootstrap import Interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Scores at which profiles are taken.
THRESHOLDS: Floats = np.linspace(0.0, 1.0, 101)
#: Share of the training after which the scale of returns holds all of them: before, some are far below.
EARLY = 0.5
BANDS = "line: interquartile mean over seeds; band: 95 % interval"
ONE_SEED = "one seed each: no band"


def in_every_format(folder: Path, name: str, draw: Callable[[Path], Figure]) -> Path:
    """Draw once, write every format; the PNG's path."""
    first, *others = (folder / f"{name}{suffix}" for suffix in SUFFIXES)
    figure = draw(first)
    for path in others:
        save(figure, path)
    return first


def curves(folder: Path, variants: Sequence[VariantResult], title: str) -> Path:
    """Return and completion rate against env steps."""
    returns, completion = (
        {variant.label: (variant.bands[metric].steps, variant.bands[metric].iqm) for variant in variants}
        for metric in (RETURN, COMPLETION)
    )
    steps = "environment steps"
    low, below = bottom(list(returns.values()))
    panels = [
        Panel(returns, steps, "mean return of an evaluation episode", low),
        Panel(completion, steps, "completion rate", -0.02, 1.02),
    ]
    several = any(len(variant.used) > 1 for variant in variants)
    note = f"{BANDS if several else ONE_SEED}; deterministic evaluation episodes{below}"
    return in_every_format(folder, "curves", lambda path: draw_bands(panels, path, title, note))


def bottom(bands: Sequence[tuple[Floats, Interval]]) -> tuple[float | None, str]:
    """Where the scale of returns begins, and a word on what lies below: policies hardly trained can be far below all.

    None, and nothing to say, where that would spare less than half of the picture.
    """
    known = [(x, band) for x, band in bands if len(x)]
    if not known:
        return None, ""
    learning = EARLY * max(x[-1] for x, _ in known)
    later = [(band.low[x >= learning], band.high[x >= learning]) for x, band in known]
    low = min((float(lows.min()) for lows, _ in later if lows.size), default=0.0)
    high = max((float(highs.max()) for _, highs in later if highs.size), default=0.0)
    if min(float(band.low.min()) for _, band in known) > 2.0 * low - high:
        return None, ""
    return low - 0.1 * (high - low), "; some early returns lie below"


def profiles(folder: Path, found: Mapping[str, Interval]) -> Path:
    """Share of runs and domains above every score."""
    panel = Panel(
        {label: (THRESHOLDS, profile) for label, profile in found.items()},
        "score τ: element quality, 0 where not completed", "share of runs and domains above τ", -0.02, 1.02,
        stepped=True,
    )  # fmt: skip
    note = "band: 95 % interval"
    return in_every_format(folder, "profile", lambda path: draw_bands([panel], path, "Performance profile", note))


def improvement(folder: Path, comparisons: Sequence[Comparison], by: str) -> Path:
    """Probability of improvement of the pairs; ``by`` names the figure that they are judged by."""
    pairs = []
    for found in comparisons:
        intervals = {f"by {by}": found.by_final}
        if found.by_score is not None:
            intervals["by score on the domains"] = found.by_score
        pairs.append(Pair(found.x, found.y, intervals))
    return in_every_format(
        folder, "improvement", lambda path: draw_improvements(pairs, path, "Probability of improvement")
    )
