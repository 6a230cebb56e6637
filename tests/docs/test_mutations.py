"""The list of mutations is one of today's code, and its page is that of the list."""

from __future__ import annotations

import ast
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import mutations
import pytest
from checkout import ROOT, files
from mutations import Mutation, UnnoticedError, broken, page, tried, try_all

from envs.errors import UserError

MUTATIONS = mutations.mutations()


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.breaks)
def test_there_is_such_a_place_and_such_a_test(mutation: Mutation) -> None:
    assert mutation.file in files()
    text = (ROOT / mutation.file).read_text(encoding="utf-8")
    assert text.count(mutation.old) == 1
    ast.parse(text.replace(mutation.old, mutation.new))
    assert mutation.old != mutation.new
    place, _, name = mutation.test.partition("::")
    tests = ast.parse((ROOT / place).read_text(encoding="utf-8")).body
    assert name in {node.name for node in tests if isinstance(node, ast.FunctionDef)}


def test_none_is_there_twice() -> None:
    for said in ({one.breaks for one in MUTATIONS}, {(one.file, one.old, one.new) for one in MUTATIONS}):
        assert len(said) == len(MUTATIONS)


def test_the_page_is_that_of_the_list() -> None:
    assert (ROOT / "docs" / mutations.PAGE).read_text(encoding="utf-8") == page()


# The script, on a checkout of one file

CODE = """\
def doubled(number):
    return 2 * number
"""
TESTS = """\
from code_of import doubled

def test_it_doubles():
    assert doubled(2) == 4

def test_it_never_fails():
    doubled(2)
"""
SHORT = Mutation("Nothing is doubled", "code_of.py", "2 * number", "number", "test_of.py::test_it_doubles")


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "checkout"
    folder.mkdir()
    for name, text in (("code_of.py", CODE), ("test_of.py", TESTS), ("pytest.ini", "[pytest]\n")):
        (folder / name).write_text(text)
    monkeypatch.setattr(mutations, "copied", lambda: nullcontext(folder))
    return folder


@pytest.mark.parametrize(
    ("new", "test", "noticed"),
    [("number", "test_it_doubles", True), ("number", "test_it_never_fails", False), ("1 / 0", "test_it_doubles", False),
     ("2 *", "test_it_doubles", False)],
    ids=["asserted", "survived", "raised", "no code"],
)  # fmt: skip
def test_only_an_assertion_notices(new: str, test: str, noticed: bool, checkout: Path) -> None:
    with broken(checkout, replace(SHORT, new=new)):
        outcome = tried(checkout, [f"test_of.py::{test}"], interpreted=False)
    assert (outcome.passed, outcome.noticed) == (test == "test_it_never_fails", noticed)
    assert (checkout / "code_of.py").read_text() == CODE


def test_what_nothing_notices_is_told(checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    survivor = replace(SHORT, breaks="Nothing happens", test="test_of.py::test_it_never_fails")
    with pytest.raises(UnnoticedError, match=r"^1 of 2 mutations went unnoticed: Nothing happens$") as caught:
        try_all([SHORT, survivor])
    assert caught.value.exit_code == 1
    told = capsys.readouterr().out
    assert "1/2 noticed" in told
    assert "2/2 UNNOTICED" in told


def test_a_test_that_fails_on_sound_code_proves_nothing(checkout: Path) -> None:
    (checkout / "code_of.py").write_text(CODE.replace("2", "3"))
    with pytest.raises(UnnoticedError, match=r"^the code as it is: "):
        try_all([SHORT])


@pytest.mark.parametrize("old", ["3 * number", "number"])
def test_a_text_that_is_not_there_once_is_refused(old: str, checkout: Path) -> None:
    with pytest.raises(UserError, match="not once"), broken(checkout, replace(SHORT, old=old)):
        pass
