"""``freemesh mesh FILE --diagnose OUT.png``: everything that is wrong with an input, as a list and as a picture."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from envs.domains.load import given, load_geometry
from envs.errors import FAILED
from envs.polygons.coarse_places import coarse_places, suggestion
from envs.polygons.diagnosis import Problem, problems, readable
from envs.polygons.drawing import Reading
from envs.polygons.geometry import Geometry
from envs.readers.drawn import OpenOutlineError
from envs.types import DomainError, Floats
from freemesh_ray.formatting.table import table
from freemesh_ray.formatting.terminal import say

#: A place in a message.
PLACE = re.compile(r"\((-?[\d.]+(?:e[-+]?\d+)?), (-?[\d.]+(?:e[-+]?\d+)?)\)")

#: No segments to show.
NONE = np.zeros((0, 2, 2))


def add(group: argparse._ArgumentGroup) -> None:
    """Add the option to a group of the grammar."""
    group.add_argument("--diagnose", metavar="OUT.png",
                       help="mesh nothing: list what is wrong with the outline, and draw it; exit code 1 if anything "
                       "is")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """List and draw what is wrong.

    Raises:
        DomainError: nothing can be drawn: no such file, or one without any coordinates.
        OutputError: the picture cannot be written.
    """
    from freemesh_ray.plots import SUFFIXES
    from freemesh_ray.plots.diagnosis_plot import draw_diagnosis
    from freemesh_ray.storage.atomic import OutputError, check_writable

    picture = Path(options.diagnose)
    if picture.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{picture}: unknown format {picture.suffix or '(none)'}: use one of {', '.join(SUFFIXES)}")
    check_writable(picture)
    lines, found = diagnosis(options)
    draw_diagnosis(f"{Path(options.domain).name}: {told(len(found))}", lines, found, picture)
    rows = [(str(k), one.kind, one.place, one.told, one.fix) for k, one in enumerate(found, 1)]
    say(table(("", "what", "place", "", "fix"), rows, left=(1, 2, 3, 4)) if rows else f"{options.domain}: {told(0)}")
    return FAILED if found else 0


def told(count: int) -> str:
    """``1 place to mend``."""
    return f"{count} place{'' if count == 1 else 's'} to mend" if count else "nothing is wrong"


def diagnosis(options: argparse.Namespace) -> tuple[list[Floats], list[Problem]]:
    """The polylines of an input, and what is wrong with it.

    Raises:
        DomainError: nothing is known of its lines.
    """
    try:
        drawing, _, _ = given(options.domain, Reading(options.edge_length, tuple(options.layer), options.join))
    except OpenOutlineError as error:
        return [np.asarray(line) for line in error.lines], open_ends(error, options.domain)
    polygons = readable(drawing.polygons)
    lines = [np.concatenate([ring, ring[:1]]) for rings in polygons for ring in rings]
    found = problems(polygons)
    try:
        geometry = load_geometry(
            options.domain, layers=tuple(options.layer), join=options.join, fix_parity=options.fix_parity,
            edge_length=options.edge_length, grading=options.grading, curvature=options.curvature, allow_large=True,
            mirror=options.mirror,
        )  # fmt: skip
    except DomainError as error:
        if all(one.kind in ("gap", "too coarse") for one in found):
            if not lines:
                raise
            found.insert(0, of_message(str(error), options.domain, lines))
        return lines, found
    return lines, [*found, *too_coarse(geometry)]


def open_ends(error: OpenOutlineError, source: str) -> list[Problem]:
    """Where an outline does not close."""
    fix = str(error).rpartition("; ")[2]
    found = []
    for ends in error.gaps:
        x, y = ends.mean(axis=0).tolist()
        width = float(np.linalg.norm(ends[1] - ends[0]))
        what = f"open ends are {width:.3g} apart" if width else "a curve ends, and no other begins"
        found.append(Problem("gap", x, y, what, fix, ends[None]))
    return found or [of_message(str(error), source, error.lines)]


def of_message(message: str, source: str, lines: Sequence[Floats]) -> Problem:
    """A refusal, at the place that it names, or else in the middle."""
    text = message.removeprefix(f"{source}: ")
    what, _, fix = text.rpartition("; ")
    named = PLACE.search(text)
    points = np.concatenate([*lines, np.zeros((0, 2))])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2 if len(points) else np.zeros(2)
    x, y = (float(named[1]), float(named[2])) if named else middle.tolist()
    return Problem("outline", x, y, what or text, fix, NONE)


def too_coarse(geometry: Geometry) -> list[Problem]:
    """The segments that are too long for what is near."""
    found = []
    for region in geometry.regions:
        places = coarse_places(region.domain)
        for place in places:
            away = f", {place.apart:.3g} away" if place.apart else ""
            what = f"a segment of {place.length:.3g} beside one of {place.other:.3g}{away}"
            found.append(Problem("too coarse", place.x, place.y, what, suggestion(places, region.domain.area), NONE))
    return found
