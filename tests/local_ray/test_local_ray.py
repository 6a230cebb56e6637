"""The embedded Ray is its process's alone: it listens on the loopback device, whoever has no token is refused, and it
needs neither a home that can be written to nor a short place for temporary files."""

from __future__ import annotations

import ipaddress
import json
import os
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from processes import ROOT, outside

from freemesh_ray.local_ray.private_folder import SHORT_FOLDERS, SOCKET, SOCKET_PATH, private_folder
from freemesh_ray.storage.atomic import OutputError
from freemesh_ray.storage.lock import FILE

pytestmark = pytest.mark.slow

OWN = """
import json, os, subprocess, sys
from freemesh_ray.cli import command
from freemesh_ray.local_ray import local_ray

command.main(["domains"])  # commands import Ray at various times

STRANGER = "import ray, sys; ray.init(sys.argv[1], logging_level=50); print(len(ray.nodes()))"

with local_ray(1):
    import psutil  # Ray's own
    import ray

    ray.get(ray.remote(lambda: None).remote())
    sockets = [each for process in (psutil.Process(), *psutil.Process().children(recursive=True))
               for each in process.net_connections("tcp")]
    connect, found = [sys.executable, "-c", STRANGER, ray.get_runtime_context().gcs_address], {}
    others = {"own": {}, "other": {"RAY_AUTH_TOKEN": 64 * "0"}, "none": {"RAY_AUTH_MODE": "disabled"}}
    for who, variables in others.items():
        found[who] = subprocess.run(connect, env=os.environ | variables, capture_output=True).returncode == 0
    ours = os.path.dirname(ray._private.worker._global_node.temp_dir)
    told = {"addresses": [each.laddr.ip for each in sockets if each.status == "LISTEN"], "let in": found,
            "mode": os.stat(ours).st_mode, "parent": os.path.dirname(ours)}

print(json.dumps(told | {"left": os.path.exists(ours)}))
"""
#: Of 120 bytes.
LONG = "long" * 30


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    temporary = tmp_path_factory.mktemp("places") / LONG
    temporary.mkdir()
    done = subprocess.run(
        [sys.executable, "-c", OWN],
        env=outside() | {"PYTHONPATH": str(ROOT), "TMPDIR": str(temporary), "HOME": "/proc/nowhere"},
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_it_listens_on_the_loopback_device_only(told: dict[str, Any]) -> None:
    addresses = [ipaddress.ip_address(text) for text in told["addresses"]]
    assert len(addresses) > 3
    assert all((getattr(each, "ipv4_mapped", None) or each).is_loopback for each in addresses), addresses


def test_it_lets_in_who_has_its_token(told: dict[str, Any]) -> None:
    assert told["let in"] == {"own": True, "other": False, "none": False}


def test_its_sockets_lie_in_a_short_folder_of_its_user_s_that_is_removed(told: dict[str, Any]) -> None:
    assert stat.S_IMODE(told["mode"]) == 0o700
    assert told["parent"] in SHORT_FOLDERS
    assert not told["left"]


@pytest.mark.parametrize("variable", ["RAY_TMPDIR", "TMPDIR"])
def test_the_folder_lies_where_the_user_says_if_sockets_can(variable: str) -> None:
    with (
        tempfile.TemporaryDirectory(prefix="s", dir="/tmp") as short,
        private_folder({variable: short}) as folder,
    ):
        assert folder.parent == Path(short)
        assert len(f"{folder}{SOCKET}") <= SOCKET_PATH


def test_what_a_killed_process_left_is_removed_and_nothing_else() -> None:
    with tempfile.TemporaryDirectory(prefix="s", dir="/tmp") as short:
        left, young, foreign = (Path(short) / f"ray-{name}" for name in ("left", "young", "foreign"))
        for folder in (left, young, foreign):
            folder.mkdir(mode=0o700)
            (folder / "r").mkdir()
        for folder in (left, young):
            (folder / FILE).touch()
        with private_folder({"TMPDIR": short}) as at_work:
            for folder in (left, at_work):
                os.utime(folder / FILE, (0, 0))
            with private_folder({"TMPDIR": short}) as second:
                assert set(Path(short).iterdir()) == {young, foreign, at_work, second}


def test_ray_s_own_variable_is_not_passed_over(tmp_path: Path) -> None:
    (tmp_path / LONG).mkdir()
    with (
        pytest.raises(OutputError, match=rf"^{tmp_path / LONG}: no place for Ray's sockets: set RAY_TMPDIR to a"),
        private_folder({"RAY_TMPDIR": str(tmp_path / LONG), "TMPDIR": "/tmp"}),
    ):
        pass
    assert list((tmp_path / LONG).iterdir()) == []


def test_a_place_that_cannot_be_written_to_is_passed_over() -> None:
    with private_folder({"TMPDIR": "/proc/nowhere"}) as folder:
        assert str(folder.parent) in SHORT_FOLDERS


@pytest.mark.parametrize("depth", [0, 1])
def test_a_place_where_others_could_put_another_folder_is_passed_over(depth: int) -> None:
    with tempfile.TemporaryDirectory(prefix="s", dir="/tmp") as open_to_all:
        parent = Path(open_to_all, *["in"] * depth)
        parent.mkdir(exist_ok=True)
        Path(open_to_all).chmod(0o777)
        with private_folder({"TMPDIR": str(parent)}) as folder:
            assert str(folder.parent) in SHORT_FOLDERS
        with pytest.raises(OutputError, match="that you can write to and others cannot"):
            private_folder({"RAY_TMPDIR": str(parent)}).__enter__()
        assert list(parent.iterdir()) == []


@pytest.mark.parametrize("planted", ["a folder that others can write to", "another user's", "a link"])
def test_locks_that_others_have_planted_are_not_taken(planted: str, tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.write_text("years of work")
    os.utime(precious, (0, 0))
    with tempfile.TemporaryDirectory(prefix="s", dir="/tmp") as short:
        trap = Path(short) / "ray-12345678"
        trap.mkdir()
        trap.chmod(0o777 if planted == "a folder that others can write to" else 0o700)
        os.link(precious, trap / FILE) if planted == "a link" else (trap / FILE).symlink_to(precious)
        if planted == "another user's":
            if os.geteuid():
                pytest.skip("root only can make it another user's")
            os.chown(trap, 65534, 65534)
        elif planted == "a link":
            trap = trap.rename(tmp_path / "away")
            (Path(short) / "ray-12345678").symlink_to(trap)
        with private_folder({"TMPDIR": short}):
            pass
        assert precious.read_text() == "years of work"
        assert (trap / FILE).exists()
