"""``freemesh mesh A B ... --out FOLDER``: a table, files that are whole, failures that end it or do not."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import pytest

from freemesh_ray.batch.cluster import in_a_folder
from freemesh_ray.batch.inputs import Job
from freemesh_ray.cli import command as cli
from freemesh_ray.cli import mesh, mesh_batch

SQUARE = "POLYGON((0 0,1 0,2 0,2 1,2 2,1 2,0 2,0 1,0 0))"
BOW = "POLYGON((0 0,2 2,2 0,0 2,0 0))"
#: Both below the x axis.
LOWER, LOWER_BOW = "POLYGON((0 0,0 -1,0 -2,2 -2,2 0,1 0,0 0))", "POLYGON((0 -3,2 -5,2 -3,0 -5,0 -3))"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    return tmp_path


def files(**texts: str) -> list[str]:
    for name, text in texts.items():
        Path(f"{name}.wkt").write_text(text)
    return [f"{name}.wkt" for name in texts]


def left_in(folder: str) -> list[str]:
    return sorted(os.listdir(folder))


def test_all_files_are_meshed_and_in_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    given = files(a=SQUARE, b=f"GEOMETRYCOLLECTION({SQUARE}, {LOWER})")
    assert cli.main(["mesh", *given, "--out", "new/m", "--jobs", "1", "--format", ".msh", "--format", "vtu"]) == 0
    out, err = capsys.readouterr()
    assert left_in("new/m") == ["a.msh", "a.vtu", "b.msh", "b.vtu"]
    header, first, second = out.splitlines()
    assert header.split() == ["file", "quads", "eta", "worst", "irregular/least", "seconds"]
    assert first.split()[:2] == ["a.wkt", "4"]
    assert second.startswith("b.wkt")
    assert int(second.split()[1]) > 4
    assert "1 of 2: a.wkt: 4 quads" in err


def test_a_failure_ends_it_unless_it_is_to_keep_going(capsys: pytest.CaptureFixture[str]) -> None:
    given = files(a=SQUARE, b=BOW, c=SQUARE)
    assert cli.main(["mesh", *given, "--out", "m", "--jobs", "1"]) == 2
    assert left_in("m") == ["a.msh"]
    out, err = capsys.readouterr()
    assert "crosses itself" in out.splitlines()[-1]
    assert err.splitlines()[-1] == "freemesh: 1 of 3 files failed; --keep-going goes on with the others"
    assert cli.main(["mesh", *given, "--out", "m", "--jobs", "1", "--keep-going", "--resume"]) == 1
    assert left_in("m") == ["a.msh", "c.msh"]
    out, err = capsys.readouterr()
    assert out.splitlines()[1].endswith("meshed before")
    assert err.splitlines()[-1] == "freemesh: 1 of 3 files failed"


def test_what_is_left_out_of_a_file_is_its_failure(capsys: pytest.CaptureFixture[str]) -> None:
    (given,) = files(a=f"GEOMETRYCOLLECTION({SQUARE}, {LOWER_BOW})")
    assert cli.main(["mesh", given, "--out", "m", "--jobs", "1", "--keep-going", "--split"]) == 1
    assert left_in("m") == ["a-0.msh"]
    assert capsys.readouterr().out.splitlines()[1].endswith("1 polygon left out: 1")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["a.wkt", "b.wkt", "-o", "o.msh"], "--out FOLDER"),
        (["a.wkt", "-o", "o.msh", "--jobs", "2"], "--jobs is for many files"),
        (["a.wkt", "b.wkt", "-o", "o.msh", "--out", "m"], "one of the two"),
        (["a.wkt", "b.wkt", "--out", "o.msh"], "named like a file"),
        (["a.wkt", "b.wkt", "--out", "a.wkt"], "is a file"),
        (["a.wkt", "b.wkt", "--out", "/proc/none"], "/proc"),
        (["a.wkt", "b.wkt", "--out", "m", "--format", "stl"], ".inp"),
        (["a.wkt", "b.wkt", "--out", "m", "--policy", "none.npz"], "none.npz"),
        (["a.wkt", "x/a.dxf", "--out", "m"], "a.wkt and x/a.dxf"),
    ],
)
def test_mistakes_are_told_before_any_work(
    arguments: list[str], words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files(a=SQUARE, b=SQUARE)
    before = sorted(folder.rglob("*"))
    assert cli.main(["mesh", *arguments]) == 2
    out, err = capsys.readouterr()
    assert words in err
    assert err.count("\n") == 1
    assert (out, sorted(folder.rglob("*"))) == ("", before)


def test_files_of_one_name_do_not_meet_on_a_cluster() -> None:
    """The polygon and the sizes, from two folders."""
    (given,) = files(part=SQUARE)
    polygon = Path(given).rename("part.csv")
    polygon.write_text("0 0\n4 0\n4 4\n0 4\n")
    sizes = Path("sizes", "part.csv")
    sizes.parent.mkdir()
    sizes.write_text("2 2 1.0\n")
    options = cli.parser().parse_args(["mesh", "part.csv", "--out", "m", "--size", str(sizes)])
    job = Job(0, "part.csv", "part")
    content = mesh_batch.contents(options, job)
    assert sorted(content) == ["domain/part.csv", "size/part.csv"]
    outcome = in_a_folder(job, partial(mesh_batch.mesh_elsewhere, options, [".msh"], mesh.run_one), content)
    assert outcome.error == ""
    assert outcome.meshes[0]["elements"] >= 16


def test_a_task_of_a_cluster_brings_what_it_writes_back() -> None:
    """What it reads went with it: the folder that it was called in is not there."""
    (given,) = files(a=SQUARE)
    options = cli.parser().parse_args(["mesh", given, "--out", "m", "--size", "0.5"])
    job = Job(0, given, "a")
    content = mesh_batch.contents(options, job)
    Path(given).unlink()
    work = partial(mesh_batch.mesh_elsewhere, options, [".msh", ".png"], mesh.run_one)
    outcome = in_a_folder(job, work, content)
    assert outcome.error == ""
    assert list(outcome.files) == ["a.msh", "a.png"]
    broken = in_a_folder(job, work, {"domain/a.wkt": BOW.encode()})
    assert broken.error.startswith("a.wkt: outer ring crosses itself")
