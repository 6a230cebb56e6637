"""FASTQ: what it is told, and what becomes of what it writes; its place is taken by scripts that a test writes."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest
from exodus_sample import write_exodus

from envs.domains.load import from_rings, load
from envs.types import Domain
from freemesh_ray.compare import fastq_mesher
from freemesh_ray.compare.boundary_change import boundary_change
from freemesh_ray.compare.fastq_mesher import cards, mesh
from freemesh_ray.compare.mixed_mesh import PeerError
from freemesh_ray.compare.named_meshers import installed_peers

RING = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]
QUADS = np.array([[0, 1, 8, 7], [1, 2, 3, 8], [8, 3, 4, 5], [7, 8, 5, 6]])


def square() -> Domain:
    return from_rings(RING, name="square")


def deck(text: str) -> list[list[str]]:
    """Cards as SUPES reads them: blanks between fields, an asterisk where one goes on, 132 characters a line."""
    assert all(len(line) <= 132 for line in text.splitlines())
    assert text.isascii()
    found = [line.split() for line in text.replace("*\n", "").splitlines()]
    assert all(len(card) <= 1000 and all(len(field) <= 32 for field in card) for card in found)
    return found


def rings(text: str) -> list[np.ndarray]:
    """The loops of points that each region of a deck has, in their order; checks how lines join."""
    numbered: dict[str, dict[int, list[str]]] = {}
    for head, *fields in deck(text)[2:]:
        if len(fields) > 1:
            numbered.setdefault(head, {})[int(fields[0])] = fields[1:]
    points = {number: [float(x), float(y)] for number, (x, y) in numbered["POINT"].items()}
    found = []
    for _, *sides in numbered["REGION"].values():
        lines = [int(line) for side in sides for line in numbered["SIDE"][int(side)]]
        ends = [[int(end) for end in numbered["LINE"][line][1:3]] for line in lines]
        assert all(numbered["LINE"][line][0] == "STR" and numbered["LINE"][line][3:5] == ["0", "1"] for line in lines)
        assert [end for _, end in ends] == [start for start, _ in [*ends[1:], ends[0]]]
        found.append(np.array([points[start] for start, _ in ends]))
    return found


def area(ring: np.ndarray) -> float:
    x, y = ring.T
    return abs(0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


@pytest.mark.parametrize("name", ["T1", "D9", "part:9", "part:2"])
def test_the_deck_is_the_domain_to_the_last_bit(name: str) -> None:
    domain = load(name)
    text = cards(domain)
    found = rings(text)
    assert area(found[0]) - sum(map(area, found[1:])) == pytest.approx(domain.area, rel=1e-12)
    given = {tuple(point) for point in domain.points[np.unique(domain.segments)].tolist()}
    assert {tuple(point) for ring in found for point in ring.tolist()} == given
    assert sum(map(len, found)) == len(domain.segments)
    holes = [card for card in deck(text) if card[0] == "HOLE"]
    assert holes == ([["HOLE", "1", *map(str, range(2, len(found) + 1))]] if len(found) > 1 else [])
    assert deck(text)[-3:] == [["SCHEME", "0", "X"], ["BODY", "1"], ["EXIT"]]


def test_a_long_boundary_is_several_sides_and_one_too_long_is_refused() -> None:
    turns = np.linspace(0, 2 * np.pi, 10_001)[:-1]
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    domain = from_rings(circle[::8])
    assert np.array_equal(rings(cards(domain))[0], domain.points[domain.segments[:, 0]])
    with pytest.raises(PeerError, match="10,000 boundary points, 9,999 at most"):
        cards(from_rings(circle))


# ---- the program -----------------------------------------------------------------------------------------------------


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    """Puts a shell script on the path in FASTQ's place."""

    def put(script: str) -> None:
        path = tmp_path / "bin" / "fastq"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)

    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("SAMPLE", str(tmp_path / "sample.g"))
    monkeypatch.setenv("SEEN", str(tmp_path / "seen"))
    return put


def test_what_it_writes_is_the_mesh(program, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    domain = square()
    program('test "$EXT03$EXT04" = BATEXODUSII && test "$2" = "$FOR009" && cp "$5" "$SEEN" && cp "$SAMPLE" "$FOR009"')
    write_exodus(tmp_path / "sample.g", np.vstack([domain.points, [[1.0, 1.0]]]), [("QUAD4", QUADS)])
    made = mesh(domain, "fastq")
    assert (made.mesher, len(made.quads), len(made.triangles)) == ("fastq", 4, 0)
    assert boundary_change(made, domain).kept
    assert made.seconds > 0
    assert (tmp_path / "seen").read_text() == cards(domain)


@pytest.mark.parametrize(("script", "words"), [
    ("echo; echo ' ** NO LUCK ** '; echo; exit 1", r"^wrote no mesh: \*\* NO LUCK \*\*$"),
    ("exit 0", "^wrote no mesh$"),
    ('echo @SEQ > "$FOR009"', "its mesh cannot be read: no netCDF file"),
    ('printf "\\211HDF" > "$FOR009"', "netCDF-4"),
])  # fmt: skip
def test_what_it_cannot_do_is_one_line(script: str, words: str, program) -> None:  # type: ignore[no-untyped-def]
    program(script)
    with pytest.raises(PeerError, match=words):
        mesh(square(), "fastq")


@pytest.mark.slow
def test_one_that_does_not_end_is_ended_with_what_it_began(
    program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr(fastq_mesher, "SECONDS", 1.0)
    program('sleep 1000 & echo $! > "$SEEN"; wait')
    with pytest.raises(PeerError, match="not done after 1 s"):
        mesh(square(), "fastq")
    child = int((tmp_path / "seen").read_text())
    while is_running(child):
        time.sleep(0.01)


def is_running(process: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_without_it_it_is_absent(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    told: list[str] = []
    found = installed_peers(["fastq"], told.append)
    assert found.meshers == []
    where = "it comes with SEACAS, https://github.com/sandialabs/seacas"
    assert found.absent == {"fastq": f"fastq is not on the path; {where}"}
    assert told == [f"fastq is not on the path: its meshes are left out; {where}"]
    with pytest.raises(PeerError, match="fastq cannot be run: No such file"):
        mesh(square(), "fastq")


def test_with_it_it_is_a_peer(program) -> None:  # type: ignore[no-untyped-def]
    program("exit 0")
    assert [each.name for each in installed_peers(["fastq"], lambda line: None).meshers] == ["fastq"]
