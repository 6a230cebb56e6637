"""Whose a piece of work is: users, machines, their starts and processes are told apart, and none is given away."""

from __future__ import annotations

import json
import os
import platform
import pwd
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from checkout import ROOT
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray.storage import owner
from freemesh_ray.storage.owner import Owner

TELL = "import json; from freemesh_ray.storage.owner import Owner; print(json.dumps(Owner.here().told()))"
JSON = st.recursive(st.none() | st.booleans() | st.integers() | st.text(max_size=20), st.lists, max_leaves=3)


def test_another_process_of_this_user_is_known_and_known_to_have_ended() -> None:
    done = subprocess.run(
        [sys.executable, "-c", TELL], check=True, capture_output=True, text=True, timeout=60,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    here, other = Owner.here(), Owner.parsed(json.loads(done.stdout))
    assert other is not None
    assert other.same_user(here)
    assert other.same_boot(here)
    assert other.process != here.process
    if here.boot:
        assert other.is_gone(here, 0.0)
    assert not here.is_gone(here, 0.0)
    assert Owner.here() == here


@pytest.mark.parametrize("changed", ["user", "user's name", "machine", "name of the machine", "boot"])
def test_whatever_differs_makes_another_owner(changed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = Owner.here()
    (tmp_path / "id").write_text("f" * 32 + "\n")
    match changed:
        case "user":
            monkeypatch.setattr(os, "geteuid", lambda: 4321)
        case "user's name":
            entry = pwd.struct_passwd(("another", "x", 0, 0, "", "/", "/bin/sh"))
            monkeypatch.setattr(pwd, "getpwuid", lambda uid: entry)
        case "machine":
            monkeypatch.setattr(owner, "MACHINE", (tmp_path / "none", tmp_path / "id"))
        case "name of the machine":
            monkeypatch.setattr(platform, "node", lambda: "another")
        case "boot":
            monkeypatch.setattr(owner, "BOOT", tmp_path / "id")
    other = Owner.here()
    assert (other.user == here.user) == (not changed.startswith("user"))
    assert (other.machine == here.machine) == ("machine" not in changed)
    assert (other.boot == here.boot) == (changed != "boot")
    assert other.same_boot(here) == changed.startswith("user")


def test_where_the_system_tells_nothing_no_process_is_held_for_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("BOOT", "PROCESSES"):
        monkeypatch.setattr(owner, name, tmp_path / "none")
    monkeypatch.setattr(owner, "MACHINE", ())
    here = Owner.here()
    assert here.boot == ""
    for other in (here, replace(here, process=":4194305:"), replace(here, boot="2" * 16)):
        assert Owner.parsed(other.told()) == other
        assert not other.is_gone(here, 0.0)


@pytest.mark.parametrize("text", [None, "", "uninitialized\n", "f" * 31, "F" * 32])
def test_a_machine_without_an_id_is_not_known_again(
    text: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Containers and virtual machines of one image share their name; what one runs is not over for the other."""
    monkeypatch.setattr(owner, "_booted", lambda: 1000.0)
    monkeypatch.setattr(owner, "BOOT", tmp_path / "boot")
    monkeypatch.setattr(owner, "MACHINE", (tmp_path / "none", tmp_path / "id"))
    (tmp_path / "boot").write_text("2" * 32)
    (tmp_path / "id").write_text("f" * 32)
    here = Owner.here()
    before = replace(here, boot="1" * 16)
    assert before.ended_with_machine(here, 999.0)
    assert before.is_gone(here, 999.0)
    assert not before.ended_with_machine(here, 1001.0)
    (tmp_path / "id").unlink()
    if text is not None:
        (tmp_path / "id").write_text(text)
    here = Owner.here()
    before = replace(here, boot="1" * 16)
    assert not before.ended_with_machine(here, 999.0)
    assert not before.is_gone(here, 999.0)
    assert here.same_boot(Owner.here())


def test_ids_of_the_machine_are_not_given_away() -> None:
    told = json.dumps(Owner.here().told())
    for path in (owner.BOOT, *owner.MACHINE):
        if path.is_file():
            assert path.read_text().strip() not in told
            assert path.read_text().strip().replace("-", "")[:8] not in told


@given(name=st.sampled_from([*Owner.here().told(), "more"]), value=JSON)
def test_what_is_no_owner_is_none(name: str, value: Any) -> None:
    found = Owner.parsed(Owner.here().told() | {name: value})
    assert found is None or found.told()[name] == value
    assert Owner.parsed(value) is None
