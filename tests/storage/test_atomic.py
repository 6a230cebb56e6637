"""Files that are replaced: whole or not at all, through no link of another account's, with the modes of the umask."""

from __future__ import annotations

import ast
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from checkout import ROOT

import freemesh_ray
from envs.domains.load import load
from freemesh_ray.export import FORMATS
from freemesh_ray.storage import atomic, state_file
from freemesh_ray.storage.atomic import OutputError, refusing_links, replacing

#: The one call in each of these files that writes to a path as it is given: it is a draft's.
GIVEN_DRAFTS = {f"export/{format.module}.py": "path.write_bytes(" for format in FORMATS.values()}


@pytest.fixture(params=[0o000, 0o022, 0o077], ids=["000", "022", "077"])
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_files_and_folders_follow_the_umask(umask: int, tmp_path: Path) -> None:
    mesh = freemesh_ray.mesh(load("D4").points[:84])
    mesh_files = [tmp_path / "made" / f"mesh{suffix}" for suffix in freemesh_ray.mesher.polygon_to_mesh.SUFFIXES]
    with replacing(tmp_path / "made" / "first") as draft:
        draft.write_text("text")
    for path in mesh_files:
        mesh.write(path)
    state_file.save({"a": 1}, tmp_path / "made" / "state.npz")
    with open(tmp_path / "made" / "log", "a", opener=refusing_links) as file:
        file.write("line\n")
    for path in tmp_path.rglob("*"):
        mode = 0o777 if path.is_dir() else 0o666
        assert stat.S_IMODE(path.stat().st_mode) == mode & ~umask, path
    assert sorted((tmp_path / "made").iterdir()) == sorted(
        [*mesh_files, *(tmp_path / "made" / x for x in ("constant", "first", "log", "state.npz"))]
    )


def test_drafts_lie_where_nobody_else_may_enter(umask: int, tmp_path: Path) -> None:
    names = set()
    for _ in range(20):
        with replacing(tmp_path / "file.txt") as draft:
            (folder,) = (path for path in tmp_path.iterdir() if path.is_dir())
            assert stat.S_IMODE(folder.stat().st_mode) & 0o077 == 0
            names.add(folder.name)
            draft.write_text("text")
            assert (folder / "file.txt").read_text() == "text"
    assert len(names) == 20
    assert os.listdir(tmp_path) == ["file.txt"]


def test_no_planted_link_is_followed(tmp_path: Path) -> None:
    victim, place = tmp_path / "victim", tmp_path / "shared" / "out.txt"
    place.parent.mkdir()
    victim.write_text("precious")
    planted = [
        place.with_name(f".out.{os.getpid()}.draft.txt"),
        place.with_name("out.txt"),
        place.with_name(".out.txt.draft"),
    ]
    for link in planted:
        link.symlink_to(victim)
    with replacing(place) as draft:
        draft.write_text("new")
    assert (place.read_text(), place.is_symlink()) == ("new", False)
    for link in planted:
        link.unlink(missing_ok=True)
        link.symlink_to(victim)
        with pytest.raises(OSError, match="symbolic link"), open(link, "a", opener=refusing_links) as file:
            file.write("more")
        state_file.save({}, link)
        assert not link.is_symlink()
    assert victim.read_text() == "precious"


def test_a_folder_put_in_the_place_of_the_drafts_gets_nothing(tmp_path: Path) -> None:
    victim, place = tmp_path / "victim", tmp_path / "shared" / "out.txt"
    place.parent.mkdir()
    victim.write_text("precious")
    with replacing(place) as draft:
        (folder,) = place.parent.iterdir()
        folder.rename(tmp_path / "away")
        folder.mkdir()
        (folder / "out.txt").symlink_to(victim)
        draft.write_text("new")
    assert (place.read_text(), victim.read_text()) == ("new", "precious")


def test_a_folder_that_others_may_enter_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def swapped(prefix: str, dir: Path) -> str:
        (dir / "open").mkdir(mode=0o777)
        (dir / "open").chmod(0o777)
        return str(dir / "open")

    monkeypatch.setattr(atomic.tempfile, "mkdtemp", swapped)
    with (
        pytest.raises(OutputError, match=r"out\.txt: cannot be written .*given to another"),
        replacing(tmp_path / "out.txt"),
    ):
        pytest.fail("begun")
    assert os.listdir(tmp_path) == []


@contextmanager
def half_written(path: Path) -> Iterator[None]:
    with replacing(path) as draft:
        draft.write_text("half")
        yield


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), ValueError("wrong"), KeyboardInterrupt()])
def test_nothing_is_left_when_writing_fails(tmp_path: Path, error: BaseException) -> None:
    (tmp_path / "file").write_text("old")
    expected = OutputError if isinstance(error, OSError) else type(error)
    with pytest.raises(expected), half_written(tmp_path / "file"):
        raise error
    assert os.listdir(tmp_path) == ["file"]
    assert (tmp_path / "file").read_text() == "old"


@pytest.mark.parametrize("name", ["\udcff.json", "a" * 250 + ".obj", "=cmd|x.csv", "\x1b[2J.svg"])
def test_names_of_all_sorts_can_be_written(tmp_path: Path, name: str) -> None:
    with replacing(tmp_path / name) as draft:
        draft.write_text("text")
    assert (tmp_path / name).read_text() == "text"
    assert len(os.listdir(tmp_path)) == 1


def written_in_place(source: str) -> list[str]:
    """Lines that open a file for writing but go neither to a draft nor through an opener that refuses links."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        text = ast.unparse(node)
        if text.startswith("archive.open("):
            continue
        called = ast.unparse(node.func).split(".")[-1]
        mode = next((arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)
                     and re.fullmatch(r"[rwax]b?\+?", arg.value)), "r")  # fmt: skip
        writes = called in ("write_text", "write_bytes", "savefig", "copyfile", "copy2", "copytree", "touch") or (
            called in ("open", "fdopen") and mode[0] in "wa"
        )
        if ast.unparse(node.func) == "os.open" and re.search(r"O_(WRONLY|CREAT|TRUNC|APPEND)", text):
            writes = "O_NOFOLLOW" not in text
        if writes and "draft" not in text and "os.devnull" not in text and "refusing_links" not in text:
            found.append(text)
    return found


def test_everything_that_is_written_goes_one_way() -> None:
    wrong = ["open(x, 'w')", "path.write_text('a')", "os.open(a, os.O_WRONLY)", "path.with_name('a').open('w')"]
    right = ["open(y, 'xb')", "open(z)", "draft.write_text('b')", "os.open(a, os.O_CREAT | os.O_NOFOLLOW)"]
    assert written_in_place("\n".join(wrong + right)) == wrong
    for path in sorted((ROOT / "freemesh_ray").rglob("*.py")):
        name = path.relative_to(ROOT / "freemesh_ray").as_posix()
        found = written_in_place(path.read_text())
        if name in GIVEN_DRAFTS:
            assert [text for text in found if not text.startswith(GIVEN_DRAFTS[name])] == []
            assert len(found) == 1
        else:
            assert found == [], name


def test_a_place_can_be_written_to_or_not(tmp_path: Path) -> None:
    atomic.check_writable(tmp_path / "file")
    with suppress(PermissionError), pytest.raises(OutputError, match="is a folder"):
        atomic.check_writable(tmp_path)
    assert os.listdir(tmp_path) == []
