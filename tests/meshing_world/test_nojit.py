"""Kernels are plain Python underneath: compiled or not, they pass the same tests and give the same results."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from play import record

from envs.domains.load import load

pytestmark = pytest.mark.slow

TESTS = Path(__file__).parents[1]
SCRIPT = """
import sys, numpy
from play import record
from envs.domains.load import load
from envs.mdp.front import restart
assert not hasattr(restart, "py_func"), "still compiled"
numpy.savez(sys.argv[1], *record(load(sys.argv[2]), 1, 150, type2=sys.argv[3] == "True", scale=sys.argv[4]))
"""


def interpreted(*arguments: str) -> None:
    """Run Python without the JIT; a failure shows what it printed."""
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=TESTS, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_kernel_tests_pass_interpreted() -> None:
    names = ("kernels/test_geometry.py", "kernels/test_slot_tree.py", "test_quality.py")
    interpreted("-m", "pytest", "-p", "no:cacheprovider", *(f"meshing_world/{name}" for name in names))


@pytest.mark.parametrize(
    ("name", "type2", "scale"), [("random:11", False, "front"), ("random:3", True, "front"), ("random:3", True, "size")]
)
def test_an_episode_is_the_same_interpreted(tmp_path: Path, name: str, type2: bool, scale: str) -> None:
    interpreted("-c", SCRIPT, str(tmp_path / "episode.npz"), name, str(type2), scale)
    with np.load(tmp_path / "episode.npz") as found:
        observations, rewards, rejections, ring = found.values()
    expected = record(load(name), 1, 150, type2=type2, scale=scale)
    np.testing.assert_allclose(observations, expected[0], atol=1e-6)
    np.testing.assert_allclose(rewards, expected[1], atol=1e-9)
    np.testing.assert_array_equal(rejections, expected[2])
    np.testing.assert_allclose(ring, expected[3], atol=1e-9)
    assert (rejections == 0).sum() > 5
