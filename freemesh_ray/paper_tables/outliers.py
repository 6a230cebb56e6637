"""Outliers: how many elements lie beyond the whiskers of the paper's box plots, a mark of how steady a mesher is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.types import Floats
from freemesh_ray.compare.comparison import Compared
from freemesh_ray.compare.joint_values import pooled
from freemesh_ray.compare.output import distinct
from freemesh_ray.formatting.table import markdown
from freemesh_ray.plots.boxes import METRICS, PANELS

#: Whiskers end at the last value within so many box lengths.
WHISKER = 1.5


def outliers(compared: Sequence[Compared]) -> str:
    """The table: of each metric of an element, the share and number of values beyond the whiskers, by mesher."""
    metrics = [name for name in PANELS if METRICS[name].of == "element"]
    meshers = distinct(row.mesher for entry in compared for row in entry.rows)
    values = pooled(metrics, meshers, [mesh for entry in compared for mesh in entry.meshes])
    lines = [[METRICS[name].title, *(_cell(values[name][mesher]) for mesher in meshers)] for name in metrics]
    return (
        f"{markdown(['outliers', *meshers], lines)}\n\nShare and number of elements beyond the whiskers, which end at "
        "the last value within 1.5 box lengths. Paper: its text alone: Pave has the most, Blossom-Quad the fewest.\n"
    )


def beyond(values: Floats) -> int:
    """How many of (k,) values are further from the box of the quartiles than `WHISKER` times its length."""
    low, high = np.percentile(values, [25, 75])
    reach = WHISKER * (high - low)
    return int(((values < low - reach) | (values > high + reach)).sum())


def _cell(values: Floats) -> str:
    values = values[np.isfinite(values)]
    if not len(values):
        return "-"
    count = beyond(values)
    return f"{count / len(values):.1%} ({count:,})"
