"""FASTQ, Sandia's paving, from which CUBIT's came: a program of SEACAS, run on a deck of cards.

A card a line: POINT, LINE (two points, and into how many intervals it is divided: one), SIDE (lines), REGION (a
material, then sides), HOLE (a region, then its holes, which are regions), BODY (what is meshed), SCHEME X (paving). In
batch mode it reads the file that FOR001 names and writes the one that FOR009 names, in Exodus II; SEACAS's script sets
both from its arguments.
"""

from __future__ import annotations

import os
import signal
import subprocess
import textwrap
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from envs.polygons.rings import loops, signed_area
from envs.types import Domain
from freemesh_ray.compare.exodus_file import read_exodus
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError, assembled

#: Its name on the path.
PROGRAM = "fastq"

#: Seconds that it may take; where a front does not close, it goes on for ever.
SECONDS = 120.0

#: It takes no more points than this.
MOST_POINTS = 9999

#: Lines of a side: a card has a thousand fields at most.
SIDE_LINES = 500

#: Characters of a line, of the 132 that it reads.
WIDTH = 100

#: Bytes of what it says that are looked at, from the end.
TAIL = 4000


def mesh(domain: Domain, name: str) -> MixedMesh:
    """Mesh a domain; ``seconds`` is the wall time of the program, its start included.

    Raises:
        PeerError: it failed, took too long, or wrote what is no mesh; or the domain is too large for it.
    """
    deck = cards(domain)
    with TemporaryDirectory(prefix="freemesh-fastq-") as folder:
        given, made = Path(folder, "domain.fsq"), Path(folder, "domain.g")
        with open(given, "x", encoding="ascii") as file:
            file.write(deck)
        start = time.perf_counter()
        said = _run(given, made)
        seconds = time.perf_counter() - start
        if not made.is_file():
            raise PeerError(f"wrote no mesh{f': {said}' if said else ''}")
        try:
            points, quads, triangles = read_exodus(made)
        except (ValueError, OSError) as error:
            raise PeerError(f"its mesh cannot be read: {error}") from None
    return assembled(name, points, quads, triangles, seconds)


def cards(domain: Domain) -> str:
    """The domain as FASTQ's input: a line for each given segment, never divided.

    Raises:
        PeerError: more boundary points than it takes.
    """
    rings = loops(domain.segments)
    if (count := sum(map(len, rings))) > MOST_POINTS:
        raise PeerError(f"{count:,} boundary points, {MOST_POINTS:,} at most")
    rings.sort(key=lambda ring: -abs(signed_area(domain.points[ring])))
    points: list[str] = []
    lines: list[str] = []
    sides: list[str] = []
    regions: list[str] = []
    number = 1
    for region, ring in enumerate(rings, 1):
        last = number + len(ring) - 1
        for here, (x, y) in enumerate(domain.points[ring].tolist(), number):
            points.append(f"POINT {here} {x:.17E} {y:.17E}")
            lines.append(f"LINE {here} STR {here} {here + 1 if here < last else number} 0 1 1.0")
        begins = range(number, last + 1, SIDE_LINES)
        for side, first in enumerate(begins, len(sides) + 1):
            sides.append(_card("SIDE", side, *range(first, min(first + SIDE_LINES, last + 1))))
        regions.append(_card("REGION", region, 1, *range(len(sides) - len(begins) + 1, len(sides) + 1)))
        number = last + 1
    holes = [_card("HOLE", 1, *range(2, len(rings) + 1))] if len(rings) > 1 else []
    return "\n".join(["TITLE", "domain", *points, *lines, *sides, *regions, *holes, "SCHEME 0 X", "BODY 1", "EXIT", ""])


def _card(head: str, *numbers: int) -> str:
    """A card that may need several lines: an asterisk says that it goes on."""
    return " *\n".join(textwrap.wrap(f"{head} {' '.join(map(str, numbers))}", WIDTH))


def _run(given: Path, made: Path) -> str:
    """Run it in the folder of the deck; the last line that it said."""
    environment = os.environ | {"EXT03": "BAT", "EXT04": "EXODUSII", "FOR001": str(given), "FOR009": str(made)}
    log = given.with_suffix(".log")
    with open(log, "xb") as out:
        try:
            process = subprocess.Popen(
                [PROGRAM, "-m", str(made), "-e", "2", str(given)],
                stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT, cwd=given.parent, env=environment,
                start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise PeerError(f"{PROGRAM} cannot be run: {error.strerror}") from None
        try:
            process.wait(SECONDS)
        except subprocess.TimeoutExpired:
            raise PeerError(f"not done after {SECONDS:g} s") from None
        finally:
            if process.poll() is None:  # the script and the program that it runs
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    said = log.read_bytes()[-TAIL:].decode("ascii", "replace").splitlines()
    return next((text.strip()[:100] for text in reversed(said) if text.strip()), "")
