"""Quality: the eight metrics of three domains' meshes, ours and the conventional methods' beside the paper's."""

from __future__ import annotations

from collections.abc import Sequence

from freemesh_ray.compare.comparison import Compared
from freemesh_ray.compare.joint_values import pooled
from freemesh_ray.compare.output import distinct
from freemesh_ray.formatting.markdown import escaped
from freemesh_ray.formatting.table import markdown
from freemesh_ray.paper_tables.published import published, spread, spread_of

#: The paper's domains.
DOMAINS = ("D7", "D8", "D9")

#: Metric -> line, decimals.
LINES = {
    "singularity_authors": ("singularity (L)", ".1f"),
    "eta": ("element quality (H)", ".2f"),
    "min_angle_authors": ("min angle (L)", ".2f"),
    "max_angle_authors": ("max angle (L)", ".2f"),
    "scaled_jacobian": ("scaled Jacobian (H)", ".2f"),
    "stretch": ("stretch (H)", ".2f"),
    "taper": ("taper (L)", ".2f"),
    "triangles": ("triangles (L)", ".1f"),
}


def quality(compared: Sequence[Compared]) -> str:
    """The table: mean ± deviation, over all elements of all domains pooled, or over the domains for counts."""
    paper = published("quality")
    meshers = distinct(row.mesher for entry in compared for row in entry.rows)
    values = pooled(list(LINES), meshers, [mesh for entry in compared for mesh in entry.meshes])
    lines = [
        [
            title,
            *(spread(printed, form) for printed in paper["metrics"][key]),
            *(spread_of(values[key][name], form) for name in meshers),
        ]
        for key, (title, form) in LINES.items()
    ]
    header = ["quality", *(f"paper, {name}" for name in paper["methods"]), *meshers]
    domains = escaped(", ".join(entry.domain.name for entry in compared))
    failures = [
        "\n- " + escaped(f"{row.domain}: {row.mesher} failed and is left out of its means: {row.failure}")
        for entry in compared
        for row in entry.rows
        if row.figures is None
    ]
    return (
        f"{markdown(header, lines)}\n\nL, H: lower or higher is better. Mean ± standard deviation over all elements, "
        f"of singularity and triangles over the domains, by the authors' definitions.\nMeasured on {domains}. "
        f"Paper: {paper['source']}.\n" + "".join(failures) + ("\n" if failures else "")
    )
