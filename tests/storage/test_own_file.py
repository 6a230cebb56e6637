"""Files of this user below a folder, and everything else that a name may stand for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from freemesh_ray.storage.own_file import ForeignFileError, copy, opened, read


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of its own, with a file in another; beside it lies a foreign one."""
    (tmp_path / "run" / "plots").mkdir(parents=True)
    (tmp_path / "run" / "plots" / "a.txt").write_text("mine")
    (tmp_path / "key").write_text("a key")
    return tmp_path / "run"


def test_a_file_of_the_folder_is_read_and_copied(folder: Path) -> None:
    path = folder / "plots" / "a.txt"
    assert read(folder, path, 4) == b"mine"
    copy(folder, path, folder / "b.txt", 4)
    assert (folder / "b.txt").read_text() == "mine"
    with pytest.raises(FileExistsError):
        copy(folder, path, folder / "b.txt", 4)


def test_links_above_the_folder_are_followed(folder: Path) -> None:
    (folder.parent / "scratch").symlink_to(folder)
    assert read(folder.parent / "scratch", folder.parent / "scratch" / "plots" / "a.txt", 9) == b"mine"


@pytest.mark.parametrize("use", ["read", "copy"])
def test_a_longer_file_is_refused(use: str, folder: Path) -> None:
    path = folder / "plots" / "a.txt"
    with pytest.raises(ForeignFileError, match="is longer than 3 bytes"):
        read(folder, path, 3) if use == "read" else copy(folder, path, folder / "b.txt", 3)


def foreign(name: str, folder: Path) -> Path:
    """A path that is none of the folder's files."""
    path, key = folder / "x", folder.parent / "key"
    match name:
        case "symbolic link":
            path.symlink_to(key)
        case "symbolic link in it":
            path.symlink_to(folder / "plots" / "a.txt")
        case "hard link":
            os.link(key, path)
        case "linked folder":
            path.symlink_to(folder.parent)
            return path / "key"
        case "pipe":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case "dots":
            return folder / ".." / "key"
        case "beside":
            return key
        case "itself":
            return folder
        case "a file's inside":
            return folder / "plots" / "a.txt" / "b"
        case "relative":
            return Path("plots/a.txt")
        case "another user's":
            if os.geteuid():
                pytest.skip("files are given away by root alone")
            path.touch()
            os.chown(path, 65534, 65534)
    return path


@pytest.mark.parametrize("flags", [os.O_RDONLY, os.O_RDWR | os.O_APPEND])
@pytest.mark.parametrize("name", [
    "symbolic link", "symbolic link in it", "hard link", "linked folder", "pipe", "folder", "dots", "beside", "itself",
    "a file's inside", "relative", "another user's",
])  # fmt: skip
def test_anything_else_is_refused_at_once_and_leaves_nothing_open(name: str, flags: int, folder: Path) -> None:
    path = foreign(name, folder)
    before = len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").exists() else 0
    with pytest.raises(ForeignFileError):
        opened(folder, path, flags)
    assert before == (len(os.listdir("/proc/self/fd")) if before else 0)


def test_a_new_file_is_made_without_following_a_link(folder: Path) -> None:
    made = os.O_RDWR | os.O_CREAT | os.O_EXCL
    os.close(opened(folder, folder / "plots" / "new", made))
    assert (folder / "plots" / "new").stat().st_mode & 0o777 == 0o600
    (folder / "link").symlink_to(folder.parent / "planted")
    (folder / "there").symlink_to(folder.parent)
    for path in (folder / "link", folder / "there" / "planted"):
        with pytest.raises(OSError, match=r"exists|folder of its own"):
            opened(folder, path, made)
    assert not (folder.parent / "planted").exists()
