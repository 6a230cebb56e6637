"""Numbers of elements that are matched: meshers whose counts are known functions of the size, and Gmsh's."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from envs.domains.load import from_rings, load
from envs.types import Domain
from freemesh_ray.cli import command
from freemesh_ray.compare import named_meshers, output
from freemesh_ray.compare.boundary_change import boundary_change
from freemesh_ray.compare.comparison import compare
from freemesh_ray.compare.matching import LEAST, MOST, TOLERANCE, TRIES, match
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError, assembled
from freemesh_ray.compare.named_meshers import Mesher, peer_mesh
from freemesh_ray.compare.peers import PEERS

DOMAIN = from_rings([[0, 0], [1, 0], [1, 1], [0, 1]], name="one")


def strip(elements: int, name: str = "strip") -> MixedMesh:
    """So many rectangles beside each other."""
    x = np.linspace(0, 1, elements + 1)
    first = np.arange(elements)
    quads = np.stack([first, first + 1, first + elements + 2, first + elements + 1], axis=1)
    return assembled(name, np.concatenate([np.stack([x, 0 * x], 1), np.stack([x, 0 * x + 1], 1)]), quads, [], 0.0)


def counting(count: Callable[[float], float]) -> tuple[Callable[[Domain, float], MixedMesh], list[float]]:
    """A mesher whose number of elements is a function of the factor, and the factors it was called with."""
    asked: list[float] = []

    def resized(domain: Domain, factor: float) -> MixedMesh:
        asked.append(factor)
        return strip(max(1, round(count(factor))))

    return resized, asked


@pytest.mark.slow
@given(st.integers(50, 5000), st.floats(0.3, 3.0), st.floats(0.7, 2.5), st.floats(0, 0.04))
def test_a_number_that_can_be_reached_is(wanted: int, at: float, power: float, noise: float) -> None:
    def count(factor: float) -> float:
        return wanted * (at / factor) ** power * (1 + noise * np.sin(50 * factor))

    resized, asked = counting(count)
    found = match(resized, DOMAIN, wanted)
    assert found.reached
    assert found.share == len(found.mesh) / wanted == pytest.approx(1, abs=TOLERANCE)
    assert len(asked) == found.tries <= TRIES
    assert asked[0] == 1.0
    assert found.factor in asked
    assert all(LEAST <= factor <= MOST for factor in asked)
    assert len(set(asked)) == len(asked)


@pytest.mark.slow
@given(st.integers(20, 2000), st.integers(20, 2000), st.floats(0.5, 2.0))
def test_what_cannot_be_reached_is_told_with_the_nearest(low: int, high: int, step: float) -> None:
    assume(low < high)
    wanted = (low + high) // 2
    resized, asked = counting(lambda factor: high if factor < step else low)
    found = match(resized, DOMAIN, wanted)
    assert len(asked) == found.tries <= TRIES
    nearest = min((len(resized(DOMAIN, factor)) for factor in asked[:]), key=lambda count: abs(count - wanted))
    assert abs(len(found.mesh) - wanted) == abs(nearest - wanted)
    assert found.reached == (abs(nearest / wanted - 1) <= TOLERANCE)
    assert str(found).startswith("not matched") != found.reached


def test_one_that_always_gives_the_same_ends() -> None:
    resized, asked = counting(lambda factor: 10)
    found = match(resized, DOMAIN, 100)
    assert not found.reached
    assert asked == sorted(asked, reverse=True)
    assert (asked[0], asked[-1]) == (1.0, LEAST)
    tries = len(asked)
    assert str(found) == f"not matched: 10 elements for 100 at 1.00 of the size is the nearest of {tries} tries"


def test_a_failure_on_the_way_leaves_the_best_before_it() -> None:
    def fails_when_fine(domain: Domain, factor: float) -> MixedMesh:
        if factor < 1:
            raise PeerError("too fine")
        return strip(10)

    found = match(fails_when_fine, DOMAIN, 100)
    assert (len(found.mesh), found.tries, found.reached) == (10, 1, False)
    with pytest.raises(PeerError, match="never"):
        match(lambda domain, factor: (_ for _ in ()).throw(PeerError("never")), DOMAIN, 100)


# ---- in the comparison -----------------------------------------------------------------------------------------------


def near(domain: Domain, factor: float) -> MixedMesh:
    return strip(round(150 / factor), "near")


def test_the_comparison_tells_factor_and_what_was_reached(tmp_path: Path) -> None:
    columns = [
        Mesher("ours", lambda domain: [strip(3, "raw"), strip(100, "ours")]),
        Mesher("near", lambda domain: [strip(150, "near")], near),
        Mesher("stuck", lambda domain: [strip(7, "stuck")], lambda domain, factor: strip(7, "stuck")),
        Mesher("fixed", lambda domain: [strip(9, "fixed")]),
    ]
    compare([DOMAIN], columns, tmp_path, lambda row: None, drawn=False, matched=True)
    rows = {row["mesher"]: row for row in csv.DictReader((tmp_path / "comparison.csv").open(newline=""))}
    assert list(rows) == ["raw", "ours", "near", "stuck", "fixed"]
    assert (rows["ours"]["size_factor"], rows["ours"]["remark"]) == ("", "")
    assert float(rows["near"]["size_factor"]) == pytest.approx(1.5, rel=0.06)
    assert float(rows["near"]["matched_share"]) == pytest.approx(1.0, abs=TOLERANCE)
    assert rows["near"]["remark"] == ""
    assert rows["stuck"]["remark"].startswith("not matched: 7 elements for 100")
    assert rows["fixed"]["remark"] == "not matched: its sizes cannot be varied"
    text = (tmp_path / "comparison.md").read_text()
    assert "size x | of ours" in text
    assert "- fixed: not matched: its sizes cannot be varied" in text


def test_nothing_to_match_is_told() -> None:
    def none(domain: Domain) -> list[MixedMesh]:
        raise PeerError("no luck")

    peer = Mesher("near", lambda domain: [strip(150, "near")], near)
    (compared,) = compare([DOMAIN], [Mesher("ours", none), peer], None, lambda row: None, matched=True)
    assert [row.remark for row in compared.rows] == ["", "not matched: there is no mesh to match"]
    assert "size x" not in output.tables(compared.rows, output.FULL)


def test_matching_nothing_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["compare", "T1", "--policy", "none", "--peers", "none", "--match-elements"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.slow
def test_the_command_matches_elements(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        named_meshers, "peer_mesh", lambda domain, name, *factor: strip(round(500 / (*factor, 1.0)[0]), name)
    )
    monkeypatch.setattr(named_meshers, "absence", lambda peer: "")
    arguments = ["compare", "T1", "--peers", "gmsh-8,netgen", "--out", str(tmp_path), "--no-pictures"]
    assert command.main([*arguments, "--match-elements"]) == 0
    rows = {row["mesher"]: row for row in csv.DictReader((tmp_path / "comparison.csv").open(newline=""))}
    assert float(rows["gmsh-8"]["elements"]) == pytest.approx(float(rows["freemesh"]["elements"]), rel=TOLERANCE)
    assert rows["netgen"]["remark"] == "not matched: its sizes cannot be varied"
    assert command.main(arguments) == 0
    rows = {row["mesher"]: row for row in csv.DictReader((tmp_path / "comparison.csv").open(newline=""))}
    assert rows["gmsh-8"]["elements"] == "500.0"
    assert "size_factor" not in rows["gmsh-8"]


def test_the_help_says_the_tolerance(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        command.main(["compare", "--help"])
    assert f"within {TOLERANCE:.0%}" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("name", [name for name, peer in PEERS.items() if peer.sized and not peer.crashes])
def test_larger_sizes_give_fewer_elements_on_the_same_boundary(name: str) -> None:
    pytest.importorskip("gmsh")
    domain = load("T1")
    made = [peer_mesh(domain, name, factor) for factor in (0.6, 1.6)]
    assert len(made[0]) > 2 * len(made[1])
    assert all(boundary_change(mesh, domain).kept for mesh in made)


def test_quasi_structured_quads_on_pairs_keep_the_boundary() -> None:
    pytest.importorskip("gmsh")
    domain = load("T1")
    made = peer_mesh(domain, "gmsh-quasi", 1.0)
    assert boundary_change(made, domain).kept
    assert len(made.triangles) == 0
