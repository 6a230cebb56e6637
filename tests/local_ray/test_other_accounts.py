"""A study and a benchmark that run, attacked from another account on the machine; docs/security.md tells of it.

Trainings and services are attacked in tests/training/test_processes.py and tests/serving/test_killed_processes.py.
"""

from __future__ import annotations

import os
import shutil
import stat
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from intrusion import got_by_another_account, ports
from process_tree import running

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="processes are told by /proc"),
]

STUDY = {
    "study": {"title": "Without end", "seeds": [1], "variants": {"one": None}},
    "settings": {
        "curriculum.stages": ["T1"], "runners.count": 1, "tracking.enabled": False, "budget.env_steps": 1_000_000_000,
        "budget.minutes": None, "evaluation.interval": 1_000_000_000, "learner.updates_per_step": 0.05,
    },
}  # fmt: skip

#: Arguments of each command, and a process of Ray's that it has when it is at work.
COMMANDS = {
    "study": (["study", "endless.yaml"], "ray::TransitionEnvRunner"),
    "bench": (["bench", "--part", "sampling", "--seconds", "1000"], "ray::DashboardAgent"),
}

#: Seconds until it is at work, kernels to compile included.
STARTS = 300.0


@pytest.fixture
def temporary() -> Iterator[Path]:
    """A folder for temporary files that anybody can write to, with a short path."""
    folder = Path(f"/tmp/o{os.getpid()}")
    folder.mkdir()
    folder.chmod(0o1777)
    yield folder
    shutil.rmtree(folder)


@pytest.mark.parametrize("name", COMMANDS)
def test_another_account_gets_nothing_of_it(name: str, tmp_path: Path, temporary: Path) -> None:
    (tmp_path / "endless.yaml").write_text(yaml.safe_dump(STUDY))
    arguments, at_work = COMMANDS[name]
    before = os.umask(0)  # one that forbids nothing
    try:
        with running(["-m", "freemesh_ray", *arguments], tmp_path, {"TMPDIR": str(temporary)}) as command:
            command.until(lambda: command.named(at_work), STARTS, "starts")
            command.until(lambda: len(ports(set(command.members()))) > 5, STARTS, "listens")
            (private,) = temporary.glob("ray-*")
            assert stat.S_IMODE(private.stat().st_mode) == 0o700
            shared = [path for path in temporary.iterdir() if path != private and path.lstat().st_mode & 0o077]
            assert shared == []
            sockets = [path for path in private.rglob("*") if path.is_socket()]
            assert sockets
            if os.geteuid() != 0:
                pytest.skip("only root can become another account")
            told = got_by_another_account(set(command.members()), private, spared={command.log})
            assert "\n".join(told["got"]) == ""
            assert told["refused"] > 100
    finally:
        os.umask(before)
