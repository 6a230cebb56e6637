"""Every command with a closed pipe, a full device, in any locale, with names that are no text: never a traceback."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import IO

import pytest
from checkout import ROOT

from freemesh_ray.cli.command import COMMANDS

pytestmark = pytest.mark.slow

#: A file's name as Linux takes it, and no UTF-8.
NO_TEXT = b"\xff\x1b[2J.json"
SQUARE = b'{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]]}'

#: What each command is asked for: to print results, and to name a file that is not there, or is no text.
PRINTS: Mapping[str, list[str | bytes]] = {
    "mesh": ["mesh", "D4", "-o", "d4.obj"],
    "domains": ["domains"],
    "study": ["study"],
    "compare": ["compare", "D4", "--peers", "none", "--no-pictures"],
    "convergence": ["convergence", "square", "--levels", "1"],
    "paper": ["paper", "scalability", "D4"],
    "compile": ["compile"],
    "bench": ["bench", "--help"],
    "train": ["train", "--help"],
    "report": ["report", "--help"],
    "submit": ["submit", "--help"],
    "sync": ["sync", "--help"],
    "serve": ["serve", "--help"],
}
NAMES: Mapping[str, list[str | bytes]] = {
    "mesh": ["mesh", NO_TEXT, "-o", b"\xfe.svg", "-o", b"\xfe.html", "--edge-length", "0.3"],
    "domains": ["domains", NO_TEXT],
    "train": ["train", "--config", b"nowhere/" + NO_TEXT],
    "study": ["study", b"nowhere/" + NO_TEXT],
    "report": ["report", NO_TEXT],
    "submit": ["submit", NO_TEXT],
    "sync": ["sync", NO_TEXT, "--uri", b"sqlite:///nowhere-\xff/\x1b/mlflow.db"],
    "compare": ["compare", NO_TEXT],
    "convergence": ["convergence", NO_TEXT],
    "paper": ["paper", "scalability", NO_TEXT],
    "serve": ["serve", "--policy", NO_TEXT],
    "bench": ["bench", "--policy", NO_TEXT],
    "compile": ["compile", NO_TEXT],
}


def ran(
    arguments: list[str | bytes], folder: Path, stdout: int | IO[bytes] = subprocess.PIPE,
    stderr: int | IO[bytes] = subprocess.PIPE, **environment: str,
) -> subprocess.CompletedProcess[bytes]:  # fmt: skip
    """The command in a process of its own, ended by a deadline."""
    everything = {**os.environ, "PYTHONPATH": str(ROOT), "FREEMESH_HOME": str(folder), **environment}
    return subprocess.run(
        [sys.executable, "-m", "freemesh_ray", *arguments], cwd=folder, env=everything, stdin=subprocess.DEVNULL,
        stdout=stdout, stderr=stderr, timeout=120, check=False,
    )  # fmt: skip


def test_every_command_is_tried() -> None:
    assert set(PRINTS) == set(NAMES) == set(COMMANDS)


@pytest.mark.parametrize("command", PRINTS)
def test_a_closed_pipe_ends_it_quietly(command: str, tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = ran(PRINTS[command], tmp_path, stdout=writer)
    finally:
        os.close(writer)
    assert done.returncode == 141
    assert all(not line or "compiling" in line or "elements" in line for line in done.stderr.decode().splitlines())


@pytest.mark.parametrize("command", ["mesh", "domains", "train"])
def test_a_full_device_is_one_line(command: str, tmp_path: Path) -> None:
    with open("/dev/full", "wb") as full:
        done = ran(PRINTS[command], tmp_path, stdout=full)
        last = done.stderr.decode().splitlines()[-1]
        assert last == "freemesh: standard output cannot be written (No space left on device): send it elsewhere"
        assert done.returncode == 1
        assert b"Traceback" not in done.stderr
        assert ran(["mesh", "nowhere.json", "-o", "x.obj"], tmp_path, stderr=full).returncode == 2


LOST = """
import os, sys
from freemesh_ray.formatting.terminal import OutputLostError, prepare, say
prepare()
try:
    say("first")
except OutputLostError as lost:
    say("second")
    print("third", flush=True)
    os.write(2, f"{lost.reason}: {lost.exit_code}".encode())
"""


def test_once_it_is_lost_what_is_printed_goes_nowhere(tmp_path: Path) -> None:
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            [sys.executable, "-c", LOST], stdout=full, stderr=subprocess.PIPE, timeout=60, check=False,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, b"No space left on device: 1")


def test_closed_streams_are_none(tmp_path: Path) -> None:
    line = [sys.executable, "-m", "freemesh_ray", "mesh", "D4", "-o", "d4.obj"]
    for closed in (">&-", ">&- 2>&-"):
        done = subprocess.run(
            ["sh", "-c", f'"$@" {closed}', "sh", *line], cwd=tmp_path, capture_output=True, timeout=120, check=False,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, b""), closed


@pytest.mark.parametrize("command", NAMES)
def test_names_that_are_no_text(command: str, tmp_path: Path) -> None:
    place = os.fsencode(tmp_path)
    with open(os.path.join(place, NO_TEXT), "wb") as file:
        file.write(SQUARE)
    # Where ASCII is all that can be printed, what it takes is the most.
    done = ran(NAMES[command], tmp_path, LC_ALL="C", PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    shown = done.stdout + done.stderr
    assert b"Traceback" not in shown, shown.decode()
    assert not re.search(rb"[^\n -~]", shown)
    if command == "mesh":
        assert done.returncode == 0
        assert b"\\udcff\\x1b[2J: " in done.stdout
        assert {b"\xfe.svg", b"\xfe.html"} < set(os.listdir(place))
    elif command in ("compare", "paper"):  # what they mesh, they show
        assert done.returncode == 0
    else:
        assert done.returncode == 2
        assert shown.count(b"\n") == 1, shown.decode()


@pytest.mark.parametrize("locale", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONUTF8": "0"}])
def test_any_locale_will_do(locale: dict[str, str], tmp_path: Path) -> None:
    done = ran(["domains"], tmp_path, **locale)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"T1" in done.stdout
    done = ran(["mesh", "D4", "-o", "größe-形.svg"], tmp_path, **locale)
    assert (done.returncode, done.stderr) == (0, b"")
    assert (tmp_path / "größe-形.svg").is_file()
