"""The scripts behind the pages of measurements: how they are started, and how they refuse."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import learning_curves
import numpy as np
import pytest
from checkout import ROOT

FOLDER = ROOT / "docs/benchmarks"
SCRIPTS = sorted(path.name for path in FOLDER.glob("*.py") if "__main__" in path.read_text())


def run(name: str, *arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a script as a page says, but from a folder where it must leave nothing."""
    done = subprocess.run(
        [sys.executable, FOLDER / name, *arguments], cwd=folder, capture_output=True, text=True, timeout=120
    )
    assert not list(folder.iterdir())
    return done


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("scaling.py", ["--out", "/proc/self/status/here"]),
        ("learning_curves.py", ["--out", "/proc/self/status/here"]),
        ("pendulum.py", ["--out", "here"]),
    ],
)
def test_a_script_refuses_in_one_line(name: str, arguments: list[str], tmp_path: Path) -> None:
    done = run(name, *arguments, folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(rf"{name}: .+\n", done.stderr), done.stderr


def test_pages_name_scripts_that_are_there() -> None:
    named = {
        name for page in ROOT.glob("docs/*.md") for name in re.findall(r"docs/benchmarks/(\w+\.py)", page.read_text())
    }
    assert named == set(SCRIPTS)


def test_returns_are_averaged_between_edges() -> None:
    means = learning_curves.binned([(5, 1.0), (10, 3.0), (11, 7.0)], np.array([0, 10, 20, 30]))
    np.testing.assert_equal(means, [2.0, 7.0, np.nan])
