"""Trees of plain values and arrays: what is saved comes back, what is damaged is told, nothing is ever unpickled."""

from __future__ import annotations

import json
import pickle
import zipfile
from collections import OrderedDict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from traced_memory import little_memory

from freemesh_ray.storage import free_memory, state_file
from freemesh_ray.storage.array_archive import read_arrays
from freemesh_ray.storage.state_file import StateFileError

scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text()
dtypes = st.sampled_from(["bool", "uint8", "int32", "int64", "float32", "float64", "<U5"])
leaves = scalars | arrays.arrays(dtypes, arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4))
keys = st.none() | st.integers() | st.text()
trees = st.recursive(
    leaves,
    lambda inner: (
        st.lists(inner, max_size=4) | st.lists(inner, max_size=4).map(tuple) | st.dictionaries(keys, inner, max_size=4)
    ),
    max_leaves=20,
)


def same(one: Any, other: Any) -> bool:
    """Equal in value and type; nan equals nan."""
    if isinstance(one, np.ndarray):
        return (
            isinstance(other, np.ndarray)
            and one.dtype == other.dtype
            and one.shape == other.shape
            and (one.tobytes() == other.tobytes())
        )
    if type(one) is not type(other):
        return False
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other or (one != one and other != other)


@pytest.mark.slow
@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(trees)
def test_what_is_saved_comes_back(tmp_path: Path, tree: Any) -> None:
    state_file.save(tree, tmp_path / "tree")
    assert same(state_file.load(tmp_path / "tree"), tree)


def test_named_tuples_ordered_dicts_and_numpy_scalars_become_plain(tmp_path: Path) -> None:
    class Pair(NamedTuple):
        left: int
        right: Any

    tree = OrderedDict(pair=Pair(1, np.float32(0.5)), many=np.int64(2**40), huge=2**120)
    state_file.save(tree, tmp_path / "tree")
    assert same(state_file.load(tmp_path / "tree"), {"pair": (1, 0.5), "many": 2**40, "huge": 2**120})


@pytest.mark.parametrize("foreign", [object(), {1, 2}, b"bytes", lambda: 0, np.array([object()], dtype=object)])
def test_what_would_need_pickle_is_refused(tmp_path: Path, foreign: Any) -> None:
    with pytest.raises(TypeError, match="not something that a state file holds"):
        state_file.save({"a": [foreign]}, tmp_path / "tree")


@pytest.fixture
def whole(tmp_path: Path) -> bytes:
    state_file.save(
        {"a": np.arange(50.0), "b": [1, (2, None)], "c": {3: np.ones((2, 3), np.float32)}}, tmp_path / "tree"
    )
    return (tmp_path / "tree").read_bytes()


@pytest.mark.slow
def test_a_file_cut_short_anywhere_is_told(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "cut"
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with pytest.raises(StateFileError, match="damaged"):
            state_file.load(path)


@pytest.mark.slow
def test_a_changed_byte_is_told_or_changes_nothing(tmp_path: Path, whole: bytes) -> None:
    expected, path = state_file.load(tmp_path / "tree"), tmp_path / "changed"
    for at in range(len(whole)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x20]) + whole[at + 1 :])
        try:
            found = state_file.load(path)
        except StateFileError:
            continue
        assert same(found, expected)  # a byte that nobody reads, as a time stamp


class Payload:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


def test_pickles_in_it_are_not_run(tmp_path: Path) -> None:
    mark, path = tmp_path / "mark", tmp_path / "evil"
    path.write_bytes(pickle.dumps(Payload(mark)))
    with pytest.raises(StateFileError):
        state_file.load(path)
    with zipfile.ZipFile(path, "w") as archive:
        with archive.open("0.npy", "w") as entry:
            np.lib.format.write_array(entry, np.array([Payload(mark)], dtype=object), allow_pickle=True)
        archive.writestr(state_file.TREE, json.dumps({"array": 0}))
    with pytest.raises(StateFileError, match="neither numbers nor text"):
        state_file.load(path)
    assert not mark.exists()


def archive_of(path: Path, tree: bytes, packed: bool = False) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED) as archive:
        archive.writestr(state_file.TREE, tree)
    return path


@pytest.mark.slow
def test_a_tree_that_unpacks_to_gigabytes_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "bomb"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open(state_file.TREE, "w") as entry:
        for _ in range(300):
            entry.write(b" " * 1_000_000)
        entry.write(b"0")
    assert path.stat().st_size < 1_000_000
    with little_memory(3_000_000), pytest.raises(StateFileError, match=r"bomb: damaged \(.*unpacked"):
        state_file.load(path)


@pytest.mark.parametrize(("tree", "words"), [
    (b" " * state_file.MOST_TREE + b"0", "more than 4,000,000 bytes"),
    (b"[" * 100_000 + b"]" * 100_000, "recursion"),
    (json.dumps({"dict": [[i * (2**61 - 1), 0] for i in range(50_000)]}).encode(), "dict of more than 10,000 entries"),
    (b"9" * 10_000, "digits"),
    (b'{"array": 3}', "3"),
    (b'{"dict": [[[], 1]]}', "unhashable"),
    (b'{"tuple": 3}', "not iterable"),
    (b"{}", "unpack"),
])  # fmt: skip
def test_trees_made_to_harm_are_damaged_ones(tmp_path: Path, tree: bytes, words: str) -> None:
    with little_memory(250_000_000), pytest.raises(StateFileError, match=f"(?s)damaged .*{words}") as error:
        state_file.load(archive_of(tmp_path / "evil", tree))
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_tree_of_lists_takes_a_bounded_multiple_of_its_bytes(tmp_path: Path) -> None:
    path = archive_of(tmp_path / "lists", b"[" + b"[]," * 1_300_000 + b"[]]")
    with little_memory(100 * path.stat().st_size):
        assert len(state_file.load(path)) == 1_300_001


def test_packed_and_overlapping_members_are_refused(tmp_path: Path, whole: bytes) -> None:
    with pytest.raises(StateFileError, match="packed"):
        state_file.load(archive_of(tmp_path / "packed", json.dumps("text" * 5).encode(), packed=True))
    # The directory's entries of the arrays are given tenfold: the same bytes stand for ten arrays.
    with zipfile.ZipFile(tmp_path / "twice", "w") as archive:
        archive.writestr(state_file.TREE, "0")
        archive.writestr("0.npy", b"x" * 10_000)
        (entry,) = (member for member in archive.infolist() if member.filename == "0.npy")
        archive.filelist += [entry] * 9
    with pytest.raises(StateFileError, match="unpacked"):
        state_file.load(tmp_path / "twice")


def test_a_directory_of_a_million_members_is_refused_unread(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "many", "w") as archive:
        archive.writestr(state_file.TREE, "0")
        archive.writestr("0.npy", b"")
        archive.filelist += archive.filelist[-1:] * 100_000
    with little_memory(3_000_000), pytest.raises(StateFileError, match="directory"):
        state_file.load(tmp_path / "many")
    with little_memory(3_000_000), pytest.raises(ValueError, match="directory"):
        read_arrays(tmp_path / "many")


def test_memory_that_is_short_is_no_damage(tmp_path: Path, whole: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_memory, "available", lambda: 100.0)
    with pytest.raises(free_memory.MemoryShortError, match=r"tree: it takes .* GB of memory"):
        state_file.load(tmp_path / "tree")
