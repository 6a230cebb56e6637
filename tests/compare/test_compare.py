"""The comparison: rows and failures, its arithmetic, what lies in the folder, and the command."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from envs.domains.load import from_rings
from envs.mesh import Mesh
from envs.types import Domain, DomainError, MeshingParameters
from freemesh_ray import export, plots
from freemesh_ray.cli import command
from freemesh_ray.compare import output
from freemesh_ray.compare.comparison import box_values, compare
from freemesh_ray.compare.joint_values import pooled
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError, assembled
from freemesh_ray.compare.named_meshers import OURS, RAW, Mesher, ours
from freemesh_ray.compare.row import Row, figures
from freemesh_ray.formatting.table import markdown
from freemesh_ray.mesh_geometry.metrics import by_element
from freemesh_ray.mesher import MeshResult
from freemesh_ray.policies.policy import Policy

RING = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]
QUADS = [[0, 1, 8, 7], [1, 2, 3, 8], [8, 3, 4, 5], [7, 8, 5, 6]]


def square(name: str = "square", scale: float = 1.0) -> Domain:
    return from_rings(scale * np.array(RING, dtype=float), name=name)


def squares(domain: Domain, middle: float = 1.0) -> Mesh:
    """Four elements around a vertex near the middle."""
    vertices = np.vstack([domain.points, domain.points[4:5] / 2 * [middle, 1.0]])
    return Mesh(domain.name, vertices, np.array(QUADS), domain.segments, True)


def mixed(domain: Domain, mesher: str, seconds: float = 0.5, middle: float = 1.0) -> MixedMesh:
    return assembled(mesher, squares(domain, middle).vertices, QUADS, [], seconds)


def halves(domain: Domain, mesher: str = "halves") -> MixedMesh:
    """Every square in two triangles, but one."""
    triangles = [[a, b, c] for q in QUADS[1:] for a, b, c in ([q[0], q[1], q[2]], [q[0], q[2], q[3]])]
    return assembled(mesher, squares(domain).vertices, QUADS[:1], triangles, 0.1)


def finer(domain: Domain) -> MixedMesh:
    """A grid of four by four: every given segment is halved."""
    side = np.linspace(0, 2, 5)
    vertices = np.array([[x, y] for y in side for x in side])
    corner = [5 * row + column for row in range(4) for column in range(4)]
    return assembled("halved", vertices, [[i, i + 1, i + 6, i + 5] for i in corner], [], 0.1)


def failing(domain: Domain) -> list[MixedMesh]:
    raise PeerError("no\nluck")


MESHERS = [
    Mesher("good", lambda domain: [mixed(domain, "good")]),
    Mesher("bad", failing),
    Mesher("halves", lambda domain: [halves(domain)]),
]


# ---- rows ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_failures_are_rows(tmp_path: Path) -> None:
    seen: list[Row] = []
    done = compare([square("a"), square("b", 3.0)], MESHERS, tmp_path, seen.append)
    assert [(row.domain, row.mesher) for row in seen] == [(d, m) for d in "ab" for m in ("good", "bad", "halves")]
    assert seen == [row for entry in done for row in entry.rows]
    assert [row.failure for row in seen] == ["", "no luck", ""] * 2
    assert [row.boundary is not None and row.boundary.kept for row in seen] == [True, False, True] * 2
    assert [len(entry.meshes) for entry in done] == [2, 2]
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"comparison.md", "comparison.csv", "comparison.json", "a.png", "b.png", "boxes.png"}


def test_pictures_can_be_left_out(tmp_path: Path) -> None:
    compare([square()], MESHERS, tmp_path, lambda row: None, drawn=False)
    assert {path.name for path in tmp_path.iterdir()} == {"comparison.md", "comparison.csv", "comparison.json"}


@pytest.mark.slow
def test_an_interrupt_leaves_what_is_finished(tmp_path: Path) -> None:
    def interrupted(domain: Domain) -> list[MixedMesh]:
        if domain.name == "b":
            raise KeyboardInterrupt
        return [mixed(domain, "last")]

    with pytest.raises(KeyboardInterrupt):
        compare([square("a"), square("b")], [MESHERS[0], Mesher("last", interrupted)], tmp_path, lambda row: None)
    rows = list(csv.DictReader(io.StringIO((tmp_path / "comparison.csv").read_text())))
    assert [(row["domain"], row["mesher"]) for row in rows] == [("a", "good"), ("a", "last"), ("b", "good")]
    assert {path.name for path in tmp_path.glob("*.png")} == {"a.png", "boxes.png"}
    assert not list(tmp_path.glob(".*draft*"))


def test_csv_holds_every_bit(tmp_path: Path) -> None:
    domain = square()
    compare([domain], [Mesher("x", lambda d: [mixed(d, "x", 0.123456789, 1.1)])], tmp_path, lambda row: None)
    (row,) = csv.DictReader(io.StringIO((tmp_path / "comparison.csv").read_text()))
    for key, value in figures(mixed(domain, "x", 0.123456789, 1.1), domain).items():
        assert float(row[key]) == value
    assert (row["keeps_boundary"], row["boundary_points_added"], row["boundary_points_lost"]) == ("1", "0", "0")


def strict(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


def test_json_holds_what_the_csv_does(tmp_path: Path) -> None:
    absent = {"gone": "gone is not installed; pip install gone"}
    compare([square()], [*MESHERS, Mesher("x", lambda d: [mixed(d, "x", math.nan)])], tmp_path, lambda row: None,
            drawn=False, absent=absent)  # fmt: skip
    read = json.loads((tmp_path / "comparison.json").read_text(), parse_constant=strict)
    assert read["absent"] == absent
    table = list(csv.DictReader(io.StringIO((tmp_path / "comparison.csv").read_text())))
    assert [row["mesher"] for row in read["rows"]] == [row["mesher"] for row in table] == ["good", "bad", "halves", "x"]
    for one, other in zip(read["rows"], table, strict=True):
        for key, cell in other.items():
            value = one.get(key)
            assert cell == ("" if value is None else str(value)), key
    assert read["rows"][3]["seconds"] is None


def test_who_took_no_part_is_told_in_every_table(tmp_path: Path) -> None:
    rows = [row for entry in compare([square()], MESHERS, None, lambda row: None) for row in entry.rows]
    absent = {"a-1": "a is not installed; pip install a", "b": "no b", "a-2": "a is not installed; pip install a"}
    for text in (output.text(rows, absent), output.summary(rows, absent)):
        assert text.count("a-1, a-2: a is not installed; pip install a") == 1
        assert text.count("- b: no b") == 1
    assert "Not compared" not in output.text(rows)


def test_two_domains_of_one_name_are_refused() -> None:
    with pytest.raises(DomainError, match="square: two domains of this name"):
        compare([square(), square()], MESHERS, None, lambda row: None)


def test_our_mesher_gives_raw_and_finished() -> None:
    domain = square()
    raw, finished = squares(domain, 1.3), squares(domain)
    both = ours(lambda d: MeshResult(raw, finished, 0.5, 0.75)).run(domain)
    assert [(mesh.mesher, mesh.seconds) for mesh in both] == [(RAW, 0.5), (OURS, 0.75)]
    assert figures(both[0], domain)["eta"] < figures(both[1], domain)["eta"] == pytest.approx(1.0)
    (only,) = ours(lambda d: MeshResult(raw, raw, 0.5, 0.5)).run(domain)
    assert only.mesher == OURS


# ---- tables ----------------------------------------------------------------------------------------------------------


def test_means_are_over_what_each_completed() -> None:
    first = figures(mixed(square("a"), "x", 0.1), square("a"))
    second = figures(mixed(square("b"), "x", 0.3, 1.4), square("b"))
    found = output.means([first, second])
    assert found["eta"] == pytest.approx((first["eta"] + second["eta"]) / 2)
    assert found["milliseconds"] == pytest.approx(200.0)
    assert found["elements_per_second"] == pytest.approx(8 / 0.4)
    assert all(math.isnan(value) for value in output.means([]).values())


def test_tables_of_all_domains_and_their_means() -> None:
    done = compare([square("a"), square("b")], MESHERS, None, lambda row: None)
    rows = [row for entry in done for row in entry.rows]
    text = output.text(rows)
    assert text.count("### ") == 3
    assert "### a" in text
    assert "- bad failed: no luck" in text
    lines = text[text.index("### Mean") :].splitlines()
    assert [line.split("|")[1].strip() for line in lines[4:7]] == ["good", "bad", "halves"]
    assert [line.split("|")[-2].strip() for line in lines[4:7]] == ["2/2", "0/2", "2/2"]
    assert "that all completed" not in text, "nobody completed all"
    more = compare([square("c"), square("d")], [MESHERS[0], MESHERS[2]], None, lambda row: None)
    text = output.text([*rows, *(row for entry in more for row in entry.rows)])
    shared = text[text.index("### Mean over the 2 domains that all completed") :].splitlines()
    assert [line.split("|")[-2].strip() for line in shared[4:6]] == ["2/2", "2/2"]


def test_a_markdown_table_lines_up() -> None:
    lines = markdown(["a", "long title"], [["wide cell", "1"], ["x", "22"]]).splitlines()
    assert len({len(line) for line in lines}) == 1
    assert lines[1] == "|-----------|-----------:|"


def test_the_summary_fits_a_terminal_and_holds_the_same_figures() -> None:
    done = compare([square("a"), square("b")], MESHERS, None, lambda row: None)
    rows = [row for entry in done for row in entry.rows]
    brief, full = output.summary(rows), output.text(rows)
    assert max(map(len, brief.splitlines())) <= 120
    assert "|" not in brief
    assert "- bad failed: no luck" in brief
    good = next(line for line in brief.splitlines() if line.startswith("good")).split()
    columns = [cell.strip() for cell in next(line for line in full.splitlines() if "| good" in line).split("|")]
    assert good[1:3] == columns[2:4]
    assert good[5] == columns[8]


def test_who_is_best_is_told_by_every_column() -> None:
    meshers = [MESHERS[0], MESHERS[2], Mesher("slow", lambda domain: [mixed(domain, "slow", 2.0, 1.3)])]
    rows = [row for entry in compare([square("a"), square("b")], meshers, None, lambda row: None) for row in entry.rows]
    for text in (output.summary(rows), output.text(rows).replace("\\", "")):
        told = [part.replace("\n", " ") for part in text.split("\n\n") if part.startswith("Best: ")]
        assert len(told) == 3, "each domain and the means"
        for line in told:
            found = dict(part.split(" ", 1) for part in line.removeprefix("Best: ").rstrip(".").split("; "))
            assert found["tri"] == "good, slow (0)"
            assert found["irregular" if "irregular" in found else "sing"].startswith("good, slow (0)")
            assert found["eta"] == "good, halves (1.000)"
            assert found["ms"] == "halves (100.0)"
            assert found["count"].startswith("good, slow (1.00)")
            assert "elements" not in found


def test_nobody_is_best_alone_or_where_all_are() -> None:
    rows = [row for entry in compare([square()], MESHERS[:2], None, lambda row: None) for row in entry.rows]
    assert "Best:" not in output.text(rows)
    twin = Mesher("twin", lambda domain: [mixed(domain, "twin")])
    rows = [row for entry in compare([square()], [MESHERS[0], twin], None, lambda row: None) for row in entry.rows]
    assert "Best:" not in output.text(rows)


def test_sizes_and_angles_are_measured_against_the_boundary() -> None:
    found = figures(finer(square()), square())
    assert found["longest_edge"] == pytest.approx(0.5)
    assert found["elements_over_wanted"] == pytest.approx(4.0)
    assert (found["sized_share"], found["neighbour_ratio"]) == (0.0, pytest.approx(1.0))
    assert found["angles_60_120"] == found["angles_45_135"] == 1.0
    found = figures(mixed(square(), "x"), square())
    assert [found[key] for key in ("longest_edge", "elements_over_wanted", "sized_share")] == pytest.approx([1, 1, 1])


# ---- pictures --------------------------------------------------------------------------------------------------------


def test_pooled_values_are_those_of_all_elements_or_one_a_mesh() -> None:
    a, b = mixed(square("a"), "x", middle=1.4), mixed(square("b"), "x")
    metrics = ["eta", "triangles", "singularity_authors"]
    found = pooled(metrics, ["x", "halves", "never"], [a, halves(square("a")), b])
    assert list(found) == metrics
    assert all(list(of_mesher) == ["x", "halves", "never"] for of_mesher in found.values())
    np.testing.assert_array_equal(found["eta"]["x"], np.concatenate([by_element(a)["eta"], by_element(b)["eta"]]))
    assert found["triangles"]["halves"].tolist() == [6]
    assert found["singularity_authors"]["x"].tolist() == [0, 0]
    assert all(len(of_mesher["never"]) == 0 for of_mesher in found.values())


def test_pictures_tell_who_failed_and_who_changed_the_boundary() -> None:
    def partly(domain: Domain) -> list[MixedMesh]:
        return failing(domain) if domain.name == "b" else [mixed(domain, "partly")]

    def moved(domain: Domain) -> list[MixedMesh]:
        return [mixed(square(scale=1.1), "moved")]

    def halved(domain: Domain) -> list[MixedMesh]:
        return [finer(domain)]

    done = compare(
        [square("a"), square("b")],
        [MESHERS[1], Mesher("partly", partly), Mesher("moved", moved), Mesher("halved", halved)],
        None,
        lambda row: None,
    )
    assert list(done[0].panels) == ["bad", "partly", "moved (boundary changed)", "halved (boundary +8 points)"]
    assert [mesh is None for mesh in done[0].panels.values()] == [True, False, False, False]
    assert done[1].panels["partly"] is None
    values = box_values(done)
    assert tuple(values) == plots.PANELS
    assert all(list(of_mesher) == ["bad (0/2)", "partly (1/2)", "moved", "halved"] for of_mesher in values.values())
    assert [len(each) for each in values["eta"].values()] == [0, 4, 8, 32]


def test_triangles_alone_can_be_drawn(tmp_path: Path) -> None:
    def triangles(domain: Domain) -> list[MixedMesh]:
        return [assembled("x", domain.points, [], [[0, 1, 2], [0, 2, 3]], 1.0)]

    domain = from_rings([[0, 0], [1, 0], [1, 1], [0, 1]], name="four")
    compare([domain], [Mesher("x", triangles)], tmp_path, lambda row: None)
    assert {path.name for path in tmp_path.glob("*.png")} == {"four.png", "boxes.png"}


# ---- the command -----------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A square's file, a mesh of it, and a policy that draws nearly uniform actions, enough for eight vertices."""
    monkeypatch.chdir(tmp_path)
    Path("square.json").write_text(json.dumps(RING))
    export.write(squares(square()), "pave.inp")
    bias = np.array([0, 0, 0, 0.3, 0.3, 0.3], dtype=np.float32)
    Policy([(np.zeros((15, 6), dtype=np.float32), bias)], MeshingParameters()).save("policy.npz")
    return tmp_path


@pytest.mark.slow
def test_ours_and_a_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["compare", "square.json", "--policy", "policy.npz", "--peers", "none", "--mesh", "pave=pave.inp"]
    assert command.main([*arguments, "--out", "found"]) == 0
    out, err = capsys.readouterr()
    assert [line.split("  ")[0].strip() for line in out.splitlines()[3:6]] == ["freemesh raw", "freemesh", "pave"]
    assert [line.split(":")[0] for line in err.splitlines() if line] == [
        "square  freemesh raw", "square  freemesh", "square  pave", "written to found",
    ]  # fmt: skip
    assert {path.name for path in Path("found").iterdir()} == {
        "comparison.md", "comparison.csv", "comparison.json", "square.png", "boxes.png",
    }  # fmt: skip


def test_an_outline_is_split_for_all_alike(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("outline.wkt").write_text("POLYGON((0 0, 3 0, 3 2, 0 2, 0 0))")
    grid = from_rings([[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [3, 2], [2, 2], [1, 2], [0, 2], [0, 1]])
    quads = np.array([[0, 1, 10, 9], [1, 2, 11, 10], [2, 3, 4, 11], [9, 10, 7, 8], [10, 11, 6, 7], [11, 4, 5, 6]])
    mesh = Mesh("grid", np.vstack([grid.points, [[1, 1], [2, 1]]]), quads, grid.segments, True)
    export.write(mesh, "grid.inp")
    arguments = ["compare", "outline.wkt", "--policy", "none", "--peers", "none", "--mesh", "grid=grid.inp"]
    assert command.main([*arguments, "--edge-length", "1"]) == 0
    assert next(line for line in capsys.readouterr().out.splitlines() if line.startswith("grid ")).endswith("  kept")
    assert command.main(arguments) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("grid "))
    assert line.endswith("  +6 points")


def test_gmsh_on_a_domain_of_the_catalogue(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("gmsh")
    assert command.main(["compare", "T1", "--policy", "none", "--peers", "gmsh-default,gmsh-full-quad"]) == 0
    out = capsys.readouterr().out
    assert "\ngmsh-default " in out
    assert out.count(" kept\n") == 2
    assert sorted(path.name for path in folder.iterdir()) == ["pave.inp", "policy.npz", "square.json"]


@pytest.mark.slow
def test_missing_peers_are_left_out(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "gmsh", None)
    monkeypatch.setitem(sys.modules, "netgen.geom2d", None)
    assert command.main(["compare", "square.json", "--policy", "policy.npz"]) == 0
    out, err = capsys.readouterr()
    assert "gmsh is not installed: its meshes are left out; pip install gmsh" in err
    tables, _, absences = out.partition("Not compared:")
    assert "gmsh" not in tables
    assert (
        "- gmsh-default, gmsh-8, gmsh-full-quad, gmsh-8-quasi, gmsh-quasi: gmsh is not installed; pip install gmsh"
        in absences
    )
    assert "- netgen: netgen is not installed; pip install netgen-mesher" in absences


@pytest.mark.slow
@pytest.mark.parametrize(("arguments", "words"), [
    (["T11"], "T1"),
    (["square.json", "--peers", "gmsch"], "'gmsch' is no peer: use gmsh-default"),
    (["square.json", "--mesh", "pave.inp"], "write LABEL=FILE"),
    (["square.json", "--mesh", "a=square.json"], "square.json: unknown format"),
    (["square.json", "square.json"], "two domains of this name"),
    (["square.json", "--policy", "missing.npz"], "missing.npz"),
    (["square.json", "--policy", "none"], "nothing to compare"),
    (["square.json", "--out", "/proc/none"], "/proc"),
    (["square.json", "--out", "pave.inp"], "pave.inp"),
    ([], "DOMAIN"),
])  # fmt: skip
def test_bad_input_is_one_line(
    arguments: list[str], words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(folder.rglob("*"))
    try:
        code = command.main(["compare", "--policy", "policy.npz", "--peers", "none", *arguments])
    except SystemExit as exit_:
        code = exit_.code
    out, err = capsys.readouterr()
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert words in err
    assert sorted(folder.rglob("*")) == before
