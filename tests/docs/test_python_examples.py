"""The examples of docs/python.md run, with tiny trainings, and leave what they say."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import QUIET, ROOT, outside
from shrunk_examples import FOLDER, shrunk

EXAMPLES = sorted(path.name for path in FOLDER.glob("*.py"))


#: Ray Tune would start a Ray with a dashboard, which takes longer than Ray waits for on a busy machine.
LIGHT = """
from freemesh_ray.local_ray import local_ray
with local_ray(1):
    exec({!r})
"""


def ran(name: str, folder: Path, start: str = "exec({!r})") -> str:
    """What an example prints, started in an empty folder that is its user's home, too."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", start.format(shrunk(name))],
        cwd=folder, capture_output=True, text=True, timeout=300,
        env=outside() | QUIET | {"PYTHONPATH": str(ROOT), "HOME": str(folder), "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_on_the_page_and_short(name: str) -> None:
    text = (FOLDER / name).read_text()
    assert f"(examples/python/{name})" in (ROOT / "docs" / "python.md").read_text()
    code = [line for line in text.split('"""', 2)[2].splitlines() if line.strip()]
    assert len(code) <= (10 if name == "tune_trainable.py" else 20)


@pytest.mark.slow
def test_a_training(tmp_path: Path) -> None:
    lines = ran("train_from_python.py", tmp_path).splitlines()
    rows = [json.loads(line) for line in (tmp_path / "runs/t1/evaluations.jsonl").read_text().splitlines()]
    assert [line for line in lines if " steps: return " in line] == [
        f"{row['env_steps']:,} steps: return {row['eval_deterministic/return']:.1f}" for row in rows
    ]
    assert all(Path(path).exists() for path in lines[-2].split()[:3])
    assert " quads" in lines[-1]


@pytest.mark.slow
def test_a_callback_that_stops_early(tmp_path: Path) -> None:
    """The budget may be spent before: the class is tried alone, too."""
    assert "the best policy is that of step" in ran("stop_early.py", tmp_path)
    patience = compile(FOLDER.joinpath("stop_early.py").read_text().split("\n\nsettings")[0], "stop_early.py", "exec")
    found: dict[str, object] = {}
    exec(patience, found)
    import freemesh_ray

    callback = found["Patience"]()  # type: ignore[operator]
    for value in (1.0, 2.0, 1.0, 1.0, 3.0, 3.0, 2.0, 1.0, 2.9):
        callback.on_evaluation({"eval_deterministic/return": value})
    with pytest.raises(freemesh_ray.StopTraining):
        callback.on_evaluation({"eval_deterministic/return": 3.0})


@pytest.mark.slow
def test_a_study(tmp_path: Path) -> None:
    lines = ran("study_from_python.py", tmp_path).splitlines()
    trials = [line.split() for line in lines if line.startswith(("near ", "far "))]
    assert [trial[:3] for trial in trials] == [
        [label, seed, "finished"] for label in ("near", "far") for seed in ("1", "2")
    ]
    assert all(Path(os.path.normpath(trial[-1])).is_file() for trial in trials)
    assert Path(lines[-1].split("report: ")[1]).is_file()


@pytest.mark.slow
def test_a_grid_on_ray_tune(tmp_path: Path) -> None:
    best = Path(ran("tune_trainable.py", tmp_path, LIGHT).splitlines()[-1])
    assert best.parent == tmp_path / "ray_results" / "discounts"
    assert (best / "policy.npz").is_file()
    assert len(list(best.parent.glob("*/checkpoint_*/state.npz"))) >= 2
