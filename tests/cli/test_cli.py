"""The command as a stranger meets it: help, tables, bad input in one line with exit code 2 and nothing written."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envs.mdp.observation import observation_size
from envs.types import MeshingParameters
from freemesh_ray.cli import command as cli
from freemesh_ray.mesher import MeshingError, polygon_to_mesh
from freemesh_ray.policies.policy import Policy

SQUARE = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def policy(folder: Path) -> str:
    """Draws nearly uniform actions: enough for a square of eight vertices."""
    bias = np.array([0, 0, 0, 0.3, 0.3, 0.3], dtype=np.float32)
    Policy([(np.zeros((15, 6), dtype=np.float32), bias)], MeshingParameters()).save(folder / "policy.npz")
    return "policy.npz"


def polygon(ring: list, name: str = "part.geojson") -> str:
    Path(name).write_text(json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}))
    return name


def refused(capsys: pytest.CaptureFixture[str], folder: Path, *arguments: str) -> str:
    """Run; expect exit code 2, one line on stderr, nothing on stdout, and no new file."""
    before = sorted(folder.rglob("*"))
    try:
        code = cli.main(arguments)
    except SystemExit as exit_:
        code = exit_.code
    out, err = capsys.readouterr()
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1, err
    assert "Traceback" not in err
    assert sorted(folder.rglob("*")) == before
    return err


def test_mesh_writes_every_format(policy: str, capsys: pytest.CaptureFixture[str]) -> None:
    outputs = ["a.inp", "a.msh", "a.vtu", "a.png", "a.svg"]
    arguments = [part for output in outputs for part in ("-o", output)]
    assert cli.main(["mesh", polygon(SQUARE), *arguments, "--policy", policy]) == 0
    assert all(Path(output).stat().st_size > 0 for output in outputs)
    line = capsys.readouterr().out
    assert line.startswith("part: ")
    assert "quads" in line


@pytest.mark.parametrize(
    ("ring", "words"),
    [
        (SQUARE[:7], "odd"),
        ([[0, 0], [2, 2], [2, 0], [0, 2]], "cross"),
        ([[0, 0], [1, 0], [2, 0], [3, 0]], "area"),
        ([[0, 0], [1, 0], [1, 0], [1, 1]], "repeat"),
        ([[0, 0], [1, 0], [1, float("nan")], [0, 1]], "finite"),
        ([[0, 0], [1, 0]], "vert"),
    ],
)
def test_bad_polygons(ring: list, words: str, policy: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = polygon(ring)
    err = refused(capsys, folder, "mesh", path, "-o", "out.vtu", "--policy", policy)
    assert path in err
    assert words in err.lower()


@pytest.mark.parametrize(
    ("drawn", "segments"),
    [
        ([SQUARE[:7]], 7),
        ([SQUARE, [[0.5, 0.5], [1.5, 0.5], [1, 1.5]]], 11),
        # Its seam is walked in both directions; names are offered for what is outside.
        ([[[0, 0], [4, 0], [4, 4], [2, 2], [2, 1], [1, 1], [2, 2], [4, 4], [0, 4]]], 4),
    ],
    ids=["ring", "hole", "seam"],
)
def test_names_of_an_odd_outline_are_listed_with_its_segments_as_given(
    drawn: list, segments: int, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rings = [[*ring, ring[0]] for ring in drawn]
    Path("odd.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": rings}))
    assert cli.main(["mesh", "odd.geojson", "--list-names", "-o", "names.png"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert sum(int(row[-2]) for row in rows if row[0] == "side") == segments
    assert Path("names.png").stat().st_size


def test_what_is_no_outline_has_no_names_either(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "cross" in refused(capsys, folder, "mesh", polygon([[0, 0], [2, 2], [2, 0], [0, 2]]), "--list-names")


@pytest.mark.parametrize("command", ["train", "study"])
def test_a_home_that_cannot_be_used_is_told_by_its_variable(
    command: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FREEMESH_HOME", "/proc/none")
    key = {"train": "runs", "study": "studies"}[command]
    err = refused(capsys, folder, command, *(["algorithms", "--smoke"] if command == "study" else []))
    assert f"set FREEMESH_HOME, or paths.{key}, to another place" in err


def test_an_odd_ring_is_mended_on_request(policy: str) -> None:
    assert cli.main(["mesh", polygon(SQUARE[:7]), "-o", "out.vtu", "--policy", policy, "--fix-parity"]) == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["mesh", "nowhere.geojson", "-o", "o.vtu", "--policy", "policy.npz"], "nowhere.geojson"),
        (["mesh", "T11", "-o", "o.vtu", "--policy", "policy.npz"], "T1"),
        (["mesh", "T1", "-o", "o.stl", "--policy", "policy.npz"], ".inp"),
        (["mesh", "T1", "-o", "o.vtu", "--policy", "none.npz"], "none.npz"),
        (["mesh", "T1"], "-o"),
        (["mesh", "T11"], "no domain of this name"),
        (["mesh", "nowhere.geojson"], "no such file"),
        (["train", "--config", "missing.yaml"], "missing.yaml"),
        (["train", "--set", "learner.gama=0.9"], "learner.gamma"),
        (["train", "--set", "learner.gamma=2"], "[0, 1]"),
        (["train", "--set", "curriculum.stages=[T9]"], "T9"),
        (["train", "--set", "curriculum.stages=[T1, t1]"], "T1"),
        (["train", "--set", "paths.runs=/proc/none"], "/proc/none"),
        (["train", "--set", "tracking.uri=nonsense"], "sqlite:///"),
        (["mesh", "T1", "-o", "/proc/none/x.png", "--policy", "policy.npz"], "/proc"),
        (["mesh", "T1", "-o", "good.vtu", "-o", "/proc/none/x.vtu", "--policy", "policy.npz"], "/proc"),
        (["mesh", "T1", "-o", "good.vtu", "-o", "new/er/x.vtu"], "no folder new/er: `mkdir -p new/er` makes it"),
        (["mesh", "T1", "-o", "it's new/x.vtu"], "`mkdir -p 'it'\"'\"'s new'`"),
        (["mesh", "T1", "-o", "s3://bucket/x.vtu"], "no folder s3:/bucket"),
        (["mesh", "T1", "-o", "o.vtu", "--best-of", "0"], "[1, 1000]"),
        (["mesh", "T1", "-o", "o.vtu", "--edge-length", "-1"], "above 0"),
        (["mesh", "T1", "-o", "o.msh", "--msh-version", "3"], "2.2"),
        (["mesh", "T1", "-o", "o.vtu", "--seed", "x"], "whole number"),
        (["mesh", "a" * 300, "-o", "o.vtu", "--policy", "policy.npz"], "catalogue"),
        (["mesh", "T1", "-o", "o.vtu", "--policy", "a" * 300], "policy"),
        (["bench", "--seconds", "nan"], "seconds"),
        (["trian"], "train"),
        (["bench", "--part", "nothing"], "--part"),
    ],
)
def test_bad_arguments(
    arguments: list[str], words: str, policy: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words in refused(capsys, folder, *arguments)


@pytest.mark.parametrize("content", ["", "{", "[1, 2", "POLYGON ((", '{"type": "Point", "coordinates": [0, 0]}'])
def test_empty_and_wrong_files(content: str, policy: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("part.json").write_text(content)
    assert "part.json" in refused(capsys, folder, "mesh", "part.json", "-o", "o.vtu", "--policy", policy)


def test_a_mesh_that_cannot_be_is_no_bad_input(
    policy: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object, **options: object) -> None:
        raise MeshingError("T3: too thin")

    monkeypatch.setattr(polygon_to_mesh, "mesh_domain", refuse)
    assert cli.main(["mesh", "T3", "-o", "o.vtu", "--policy", policy]) == 1
    assert capsys.readouterr().err == "freemesh: T3: too thin\n"
    assert not Path("o.vtu").exists()


@pytest.mark.parametrize(("sources", "backtracks", "told"), [
    ({"policy": 5, "look-ahead": 2, "last": 1}, 0, []),
    ({"policy": 5, "next vertex": 0, "wide": 2, "filled": 1}, 0, ["recovery: 2 wide, 1 filled"]),
    ({"policy": 5, "next vertex": 4}, 3, ["recovery: 4 next vertex, 3 backtracks"]),
])  # fmt: skip
def test_what_helped_the_policy_is_told(
    sources: dict[str, int], backtracks: int, told: list[str], policy: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    mesh_domain = polygon_to_mesh.mesh_domain
    monkeypatch.setattr(polygon_to_mesh, "mesh_domain", lambda *given, **wishes: replace(
        mesh_domain(*given, **wishes), sources=sources, backtracks=backtracks
    ))  # fmt: skip
    assert cli.main(["mesh", polygon(SQUARE), "-o", "o.vtu", "--policy", policy]) == 0
    first, *others = capsys.readouterr().out.splitlines()
    assert first.endswith(" -> o.vtu")
    assert [line.strip() for line in others] == told


def test_the_shipped_policy_meshes_a_bare_outline(capsys: pytest.CaptureFixture[str]) -> None:
    path = polygon([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2]])
    outputs = ["a.inp", "a.html", "a.png"]
    arguments = [part for output in outputs for part in ("-o", output)]
    assert cli.main(["mesh", path, "--edge-length", "0.21", "--grading", "1.5", *arguments]) == 0
    assert all(Path(output).stat().st_size > 0 for output in outputs)
    assert re.search(r", \d+ irregular nodes \(least 0\) -> a.inp, a.html, a.png$", capsys.readouterr().out.strip())


def test_an_outline_of_four_points_needs_no_recovery(capsys: pytest.CaptureFixture[str]) -> None:
    path = polygon([[0, 0], [1, 0], [1, 1], [0, 1]])
    assert cli.main(["mesh", path, "-o", "o.obj"]) == 0
    out = capsys.readouterr().out
    assert ": 1 quad in " in out
    assert "recovery" not in out


def test_a_coarse_outline_is_told_what_helps(capsys: pytest.CaptureFixture[str]) -> None:
    path = polygon([[0, 0], [40, 0], [40, 10], [30, 10], [30, 25], [0, 25]])
    assert cli.main(["mesh", path, "-o", "o.obj"]) == 0
    assert "1 of the 6 boundary segments is too long for what is near: at (20, 0)" in capsys.readouterr().err
    assert cli.main(["mesh", path, "-o", "o.obj", "--edge-length", "2"]) == 0
    assert capsys.readouterr().err == ""


def test_sizes_inside_are_kept_to_or_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A policy that knows the size wanted makes fewer elements of larger ones; the shipped one knows none."""
    parameters = MeshingParameters(scale="size", density="local")
    layer = np.zeros((observation_size(parameters), 6), dtype=np.float32), np.array([0, 0, 0, -9, -9, -9], np.float32)
    Policy([layer], parameters).save(tmp_path / "sizes.npz")
    path, counts = polygon([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2]]), []
    line = ["mesh", path, "--edge-length", "0.1", "--effort", "quick", "-o", "a.obj"]
    for largest in ("0.1", "0.4"):
        assert cli.main([*line, "--max-size", largest, "--policy", str(tmp_path / "sizes.npz")]) == 0
        counts.append(int(capsys.readouterr().out.split()[1]))
    assert counts[0] > 1.2 * counts[1]
    line[-1] = "new.obj"
    line += ["--max-size", "0.1"]
    assert "env.scale = front and keeps to no size" in refused(capsys, tmp_path, *line, "--density", "medium")
    assert "give --min-size at most" in refused(capsys, tmp_path, *line, "--min-size", "0.2")


def test_sizes_by_place_and_arcs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The outline follows the size that is said, arcs stay arcs, and the output says how far it is off."""
    parameters = MeshingParameters(scale="size", density="local")
    layer = np.zeros((observation_size(parameters), 6), dtype=np.float32), np.array([0, 0, 0, -9, -9, -9], np.float32)
    Policy([layer], parameters).save(tmp_path / "sizes.npz")
    turn = 2 * np.pi * np.arange(96) / 96
    path = polygon(np.stack([np.cos(turn), np.sin(turn)], axis=1).tolist())
    line = ["mesh", path, "--policy", str(tmp_path / "sizes.npz")]
    segments = []
    for more in (["--edge-length", "3"], ["--edge-length", "3", "--curvature", "32"], ["--size", "0.1 + 0.02 * x"]):
        assert cli.main([*line, *more, "-o", "a.obj"]) == 0
        assert "outline: split, and off the given one by 0.0" in capsys.readouterr().out
        rows = [row.split() for row in Path("a.obj").read_text().splitlines() if row.startswith("v ")]
        vertices = [[float(x), float(y)] for _, x, y, _ in rows]
        segments.append(int((np.hypot(*np.array(vertices).T) > 0.9).sum()))
    assert segments[0] < segments[1] < segments[2]
    line += ["-o", "new.obj"]
    assert "column 7: 'z' is not known" in refused(capsys, tmp_path, *line, "--size", "0.1 * z")
    assert "give a size above 0 all over the domain" in refused(capsys, tmp_path, *line, "--size", "x")
    assert "sizes.pos: no such file" in refused(capsys, tmp_path, *line, "--size", "sizes.pos")
    assert "curvature 2.0; give" in refused(capsys, tmp_path, *line, "--edge-length", "1", "--curvature", "2")


def test_the_points_of_a_script_say_sizes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = Path("part.geo")
    script.write_text(
        "Point(1) = {0, 0, 0, 0.1}; Point(2) = {2, 0, 0, 0.5}; Point(3) = {2, 2, 0, 0.5}; Point(4) = {0, 2, 0, 0.5};"
        "Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1}; Curve Loop(1) = {1:4};"
        "Plane Surface(1) = {1};"
    )
    parameters = MeshingParameters(scale="size", density="local")
    layer = np.zeros((observation_size(parameters), 6), dtype=np.float32), np.array([0, 0, 0, -9, -9, -9], np.float32)
    Policy([layer], parameters).save(tmp_path / "sizes.npz")
    line, counts = ["mesh", str(script), "--policy", str(tmp_path / "sizes.npz"), "-o", "a.obj"], []
    for more in ([], ["--edge-length", "0.5"]):
        assert cli.main([*line, *more]) == 0
        told = capsys.readouterr()
        assert ("split by the sizes at its points; --edge-length L splits it evenly" in told.err) == (not more)
        rows = [row.split() for row in Path("a.obj").read_text().splitlines() if row.startswith("v ")]
        counts.append(sum(float(y) == 0.0 for _, _, y, _ in rows))
    assert counts[0] > counts[1] + 2


def test_polygons_of_a_file_are_one_mesh_or_one_each(policy: str, capsys: pytest.CaptureFixture[str]) -> None:
    rings = [[[x + dx, y] for x, y in [*SQUARE, SQUARE[0]]] for dx in (0, 5)]
    Path("two.geojson").write_text(json.dumps({"type": "MultiPolygon", "coordinates": [[ring] for ring in rings]}))
    assert cli.main(["mesh", "two.geojson", "-o", "out.msh", "--policy", policy]) == 0
    assert [path.name for path in Path().glob("*.msh")] == ["out.msh"]
    assert capsys.readouterr().out.startswith("two: ")
    assert cli.main(["mesh", "two.geojson", "-o", "out.msh", "--policy", policy, "--split"]) == 0
    assert sorted(path.name for path in Path().glob("*.msh")) == ["out-0.msh", "out-1.msh", "out.msh"]
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == ["two[0]", "two[1]"]


def test_domains_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["domains"]) == 0
    out = capsys.readouterr().out
    for name in ("T1", "T2", "T3", *(f"D{i}" for i in range(1, 10))):
        assert f"\n{name} " in out


@pytest.mark.parametrize("command", [[], ["train"], ["mesh"], ["domains"], ["bench"]])
def test_help_teaches(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        cli.main([*command, "--help"])
    assert exit_.value.code == 0
    assert "freemesh" in capsys.readouterr().out


def test_the_module_is_the_command() -> None:
    done = subprocess.run([sys.executable, "-m", "freemesh_ray", "domains"], capture_output=True, text=True)
    assert done.returncode == 0
    assert "T1" in done.stdout


def test_an_outline_that_is_too_coarse_is_told_before_it_is_meshed(
    policy: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object, **options: object) -> None:
        raise MeshingError("not begun")

    monkeypatch.setattr(polygon_to_mesh, "mesh_domain", refuse)
    ring = [[0, 0], [4, 0], [4, 0.1], [3.9, 0.1], [3.8, 0.1], [0, 0.1]]
    path = polygon(ring)
    assert cli.main(["mesh", path, "-o", "o.vtu", "--policy", policy]) == 1
    first, _ = capsys.readouterr().err.splitlines()
    assert first.startswith(f"{path}: 2 of the 6 boundary segments are too long")
    assert "--edge-length 0.1 splits" in first
    assert cli.main(["mesh", path, "-o", "o.vtu", "--policy", policy, "--edge-length", "0.05"]) == 1
    assert capsys.readouterr().err == "freemesh: not begun\n"
