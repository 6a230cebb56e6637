"""The comparison's tables: a brief one for the terminal, Markdown with all metrics, CSV and JSON for programs."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from types import MappingProxyType

import numpy as np

from envs.printable import printable
from freemesh_ray.compare.row import Row
from freemesh_ray.formatting.csv_text import csv_text
from freemesh_ray.formatting.markdown import escaped
from freemesh_ray.formatting.table import markdown, number, table
from freemesh_ray.storage.atomic import replacing

#: Figure -> column, format. Those marked * are by the authors' definitions.
COLUMNS: dict[str, tuple[str, str]] = {
    "elements": ("elements", ".0f"),
    "triangles": ("tri", ".1f"),
    "non_convex": ("bent", ".1f"),
    "singularity": ("sing", ".0f"),
    "singularity_least": ("least", ".0f"),
    "singularity_authors": ("sing*", ".0f"),
    "eta": ("eta", ".3f"),
    "eta_p5": ("p5", ".2f"),
    "eta_min": ("min", ".2f"),
    "min_angle": ("min angle", ".1f"),
    "min_angle_authors": ("min angle*", ".2f"),
    "max_angle": ("max angle", ".1f"),
    "max_angle_authors": ("max angle*", ".2f"),
    "angles_45_135": ("45-135", ".1%"),
    "angles_60_120": ("60-120", ".1%"),
    "scaled_jacobian": ("SJ", ".3f"),
    "stretch": ("stretch", ".3f"),
    "taper": ("taper*", ".3f"),
    "taper_paper": ("taper", ".3f"),
    "longest_edge": ("edge/h", ".2f"),
    "elements_over_wanted": ("count", ".2f"),
    "sized_share": ("sized", ".1%"),
    "neighbour_ratio": ("ratio", ".2f"),
    "milliseconds": ("ms", ".1f"),
    "elements_per_second": ("elements/s", ",.0f"),
    "size_factor": ("size x", ".2f"),
    "matched_share": ("of ours", ".0%"),
}

#: Figure -> column, format: what the terminal shows.
BRIEF_COLUMNS: dict[str, tuple[str, str]] = {
    "elements": ("elements", ".0f"),
    "triangles": ("tri", ".1f"),
    "singularity": ("irregular", ".0f"),
    "singularity_least": ("least", ".0f"),
    "eta": ("eta", ".3f"),
    "eta_p5": ("p5", ".3f"),
    "eta_min": ("min", ".3f"),
    "angles_60_120": ("60-120", ".1%"),
    "longest_edge": ("edge/h", ".2f"),
    "elements_over_wanted": ("count", ".2f"),
    "sized_share": ("sized", ".1%"),
    "milliseconds": ("ms", ".1f"),
    "size_factor": ("size x", ".2f"),
    "matched_share": ("of ours", ".0%"),
}

#: Columns that are there only where numbers of elements were matched.
MATCHED = ("size_factor", "matched_share")

#: Figure -> how far a value is from the best there can be, for those of which one is better than another.
MISSED: dict[str, Callable[[float], float]] = {
    **dict.fromkeys(
        ("triangles", "non_convex", "singularity", "singularity_authors", "min_angle", "min_angle_authors",
         "max_angle", "max_angle_authors", "taper", "taper_paper", "longest_edge", "neighbour_ratio", "milliseconds"),
        lambda value: value,
    ),
    **dict.fromkeys(
        ("eta", "eta_p5", "eta_min", "angles_45_135", "angles_60_120", "scaled_jacobian", "stretch", "sized_share",
         "elements_per_second"),
        lambda value: -value,
    ),
    "elements_over_wanted": lambda value: abs(value - 1.0),
}  # fmt: skip

#: Means of these have a decimal, their values have none.
COUNTS = ("triangles", "non_convex")

LEGEND = """\
- tri: triangles among the elements; bent: elements with a corner of 180 degrees or more
- sing: interior vertices whose valence is not 4; least: those that the boundary asks for
- eta, p5, min: mean, 5th percentile and least element quality
- min angle, max angle: |least angle - 90| and |largest angle - 90|, degrees
- SJ: scaled Jacobian; taper: by triangles' areas, as the paper words it
- 45-135, 60-120: share of the quadrilaterals whose four angles lie there, degrees
- edge/h: longest edge over the length wanted there, the boundary's own at the boundary; count: elements over the area's
  squares of that length; sized: share of the elements whose mean edge is within 25 % of it; ratio: 99th percentile of
  the larger over the smaller mean edge of two neighbours
- size x: the factor of the sizes inside at which numbers of elements were matched, 1 for the mesher's own sizes; of
  ours: elements over those to match
- boundary: kept, or the points by which the mesher split the given segments, or what it added and lost
- ms: time of the meshing alone, in means the median; elements/s: in means all elements over all seconds
- with a star, as the authors' code has them: sing*: vertices, boundary included, of other than 1, 2 or 4 elements;
  min angle*, max angle*: least and largest of the four |angle - 90|; taper*: Verdict's

Element metrics are means over the quadrilaterals.
"""


BRIEF_LEGEND = """\
least: irregular nodes that the boundary asks for. 60-120: elements with all angles there. Against h, the edge length
wanted: edge/h the longest edge, count the elements over area / h^2, sized those whose mean edge is within 25 %."""


@dataclass(frozen=True)
class Layout:
    """How tables look.

    Attributes:
        columns: figure -> column, format.
        table: header and rows -> text.
        heading: before a table's title.
        text: a name, or what went wrong, as it may stand outside of tables.
        width: characters of a line of prose.
    """

    columns: Mapping[str, tuple[str, str]]
    table: Callable[[Sequence[str], Sequence[Sequence[str]]], str]
    heading: str
    text: Callable[[str], str]
    width: int


FULL = Layout(COLUMNS, markdown, "### ", escaped, 10_000)
BRIEF = Layout(BRIEF_COLUMNS, table, "", printable, 118)


def line(row: Row) -> str:
    """A row in one line, for progress."""
    if row.figures is None:
        return f"{row.domain}  {row.mesher}: failed: {row.failure}"
    found = row.figures
    triangles = f" ({found['triangles']:.0f} of them triangles)" if found["triangles"] else ""
    boundary = f", boundary {row.boundary}" if row.boundary and not row.boundary.kept else ""
    return (
        f"{row.domain}  {row.mesher}: {found['elements']:.0f} elements{triangles}, "
        f"eta {number(found['eta'], '.3f')}, {found['singularity']:.0f} irregular, "
        f"{number(1e3 * found['seconds'], '.0f')} ms{boundary}{f'; {row.remark}' if row.remark else ''}"
    )


def text(rows: Sequence[Row], absent: Mapping[str, str] = MappingProxyType({})) -> str:
    """All tables in Markdown with all metrics, who took no part, and what the columns are."""
    return "\n\n".join([tables(rows, FULL), *absences(absent, FULL), LEGEND])


def summary(rows: Sequence[Row], absent: Mapping[str, str] = MappingProxyType({})) -> str:
    """All tables in plain text with the figures that tell most, and who took no part."""
    return "\n\n".join([tables(rows, BRIEF), *absences(absent, BRIEF), BRIEF_LEGEND])


def absences(absent: Mapping[str, str], layout: Layout) -> list[str]:
    """The peers that took no part, a line for each reason; nothing where all did."""
    lines = []
    for reason in distinct(absent.values()):
        names = ", ".join(name for name, why in absent.items() if why == reason)
        lines.append(f"- {layout.text(f'{names}: {reason}')}")
    return [f"Not compared:\n\n{chr(10).join(lines)}"] if lines else []


def tables(rows: Sequence[Row], layout: Layout) -> str:
    """One table for each domain, then the means over the domains."""
    parts = [domain_table(list(group), layout) for _, group in groupby(rows, key=lambda row: row.domain)]
    names = distinct(row.domain for row in rows)
    if len(names) > 1:
        parts.append(mean_table(rows, names, "Mean over the domains that each completed", layout))
        shared = completed_by_all(rows, names)
        if 1 < len(shared) < len(names):
            title = f"Mean over the {len(shared)} domains that all completed"
            parts.append(mean_table([row for row in rows if row.domain in shared], shared, title, layout))
    return "\n\n".join(parts)


def trimmed(layout: Layout, rows: Sequence[Row]) -> Layout:
    """The layout without the columns of a match where nothing was matched."""
    if any(row.figures and MATCHED[0] in row.figures for row in rows):
        return layout
    return replace(layout, columns={key: column for key, column in layout.columns.items() if key not in MATCHED})


def domain_table(rows: Sequence[Row], layout: Layout) -> str:
    """The meshers on one domain, and below the table why some have no mesh, or one that was not matched."""
    layout = trimmed(layout, rows)
    lines = [
        [row.mesher, *cells(plain(row.figures), layout), str(row.boundary)] for row in rows if row.figures is not None
    ]
    header = ["mesher", *(title for title, _ in layout.columns.values()), "boundary"]
    parts = [layout.heading + layout.text(rows[0].domain)]
    if lines:
        parts.append(layout.table(header, lines))
        parts += best({row.mesher: plain(row.figures) for row in rows if row.figures is not None}, layout)
    told = [f"{row.mesher} failed: {row.failure}" for row in rows if row.figures is None]
    told += [f"{row.mesher}: {row.remark}" for row in rows if row.remark]
    if told:
        parts.append("\n".join(f"- {layout.text(each)}" for each in told))
    return "\n\n".join(parts)


def mean_table(rows: Sequence[Row], domains: Sequence[str], title: str, layout: Layout) -> str:
    """Each mesher's means over its domains."""
    layout, lines, whole = trimmed(layout, rows), [], {}
    for mesher in distinct(row.mesher for row in rows):
        own = [row.figures for row in rows if row.mesher == mesher and row.figures is not None]
        lines.append([mesher, *cells(means(own), layout), f"{len(own)}/{len(domains)}"])
        if len(own) == len(domains):
            whole[mesher] = means(own)
    header = ["mesher", *(name for name, _ in layout.columns.values()), "domains"]
    return "\n\n".join([f"{layout.heading}{title}", layout.table(header, lines), *best(whole, layout)])


def best(figures: Mapping[str, Mapping[str, float]], layout: Layout) -> list[str]:
    """Who is best by each column, as its cells show it, of meshers that completed all; nothing where all are."""
    if len(figures) < 2:
        return []
    parts = []
    for key, (name, form) in layout.columns.items():
        if key not in MISSED:
            continue
        known = {mesher: each[key] for mesher, each in figures.items() if math.isfinite(each[key])}
        if len(known) < 2:
            continue
        least = min(MISSED[key](value) for value in known.values())
        first = next(value for value in known.values() if MISSED[key](value) == least)
        shown = cell(key, first, form)
        winners = [mesher for mesher, value in known.items() if cell(key, value, form) == shown]
        if len(winners) < len(known):
            parts.append(f"{name} {', '.join(winners)} ({shown})")
    return [textwrap.fill(layout.text(f"Best: {'; '.join(parts)}."), layout.width)] if parts else []


def means(figures: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Means of the figures of several meshes; ms is the median, elements/s all elements over all seconds."""
    if not figures:
        return dict.fromkeys(COLUMNS, math.nan)
    keys = distinct(key for entry in figures for key in entry)
    found = {key: float(np.mean([entry[key] for entry in figures if key in entry])) for key in keys}
    seconds = np.array([entry["seconds"] for entry in figures])
    elements = sum(entry["elements"] for entry in figures)
    found["milliseconds"] = float(1e3 * np.median(seconds))
    found["elements_per_second"] = float(elements / seconds.sum()) if seconds.sum() > 0 else math.nan
    return found


def plain(figures: Mapping[str, float]) -> dict[str, float]:
    """One mesh's figures, its time in milliseconds."""
    return {**figures, "milliseconds": 1e3 * figures["seconds"]}


def cells(figures: Mapping[str, float], layout: Layout) -> list[str]:
    """The columns' texts."""
    return [cell(key, figures.get(key, math.nan), form) for key, (_, form) in layout.columns.items()]


def cell(key: str, value: float, form: str) -> str:
    """A figure's text; counts have no decimals, but means of them do."""
    return number(value, ".0f" if key in COUNTS and value.is_integer() else form)


def completed_by_all(rows: Sequence[Row], domains: Sequence[str]) -> list[str]:
    """The domains on which nobody failed."""
    failed = {row.domain for row in rows if row.figures is None}
    return [name for name in domains if name not in failed]


def distinct(names: Iterable[str]) -> list[str]:
    """Names in the order of their first appearance."""
    return list(dict.fromkeys(names))


def write(folder: Path, rows: Sequence[Row], absent: Mapping[str, str] = MappingProxyType({})) -> None:
    """Write ``comparison.md``, ``comparison.csv`` and ``comparison.json``, each as a whole.

    Raises:
        OutputError: the folder cannot be written to.
    """
    with replacing(folder / "comparison.md") as draft:
        draft.write_text(text(rows, absent), encoding="utf-8")
    found = [values(row) for row in rows]
    keys = distinct(key for each in found for key in each)
    with replacing(folder / "comparison.csv") as draft:
        table = csv_text(keys, [[each.get(key) for key in keys] for each in found])
        draft.write_text(table, encoding="utf-8", newline="")
    with replacing(folder / "comparison.json") as draft:
        content = {
            "rows": [{key: finite(value) for key, value in each.items()} for each in found],
            "absent": {**absent},
        }
        draft.write_text(f"{json.dumps(content, indent=1, allow_nan=False)}\n", encoding="utf-8")


def values(row: Row) -> dict[str, str | float | None]:
    """A row for programs: names, figures, what became of the boundary, and what went wrong, if anything did."""
    change = row.boundary
    return {
        "domain": row.domain,
        "mesher": row.mesher,
        **(row.figures or {}),
        "keeps_boundary": int(change is not None and change.kept),
        "boundary_points_added": change.added if change else None,
        "boundary_points_lost": change.lost if change else None,
        "failure": row.failure,
        "remark": row.remark,
    }


def finite(value: str | float | None) -> str | float | None:
    """The value as JSON has it: nothing for what is no finite number."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
