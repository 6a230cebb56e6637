"""The baselines of other libraries: a few updates each, on the environment that only its name tells."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import ROOT
from processes import outside

from envs.mesh_env import MeshEnv

FOLDER = ROOT / "docs/examples/baselines"
COLUMNS = ["env_steps", "updates", "return", "completion_rate", "elements", "element_quality"]
TINY = ["--envs", "4", "--steps", "64", "--warmup", "32", "--eval-every", "16", "--eval-episodes", "2"]


def test_all_baselines_are_evaluated_in_one_way() -> None:
    """From an evaluation's first step on; test_sac_baseline.py tests what it does."""
    texts = [path.read_text() for path in sorted(FOLDER.glob("*.py"))]
    ends = [re.search(r"            returns \+= .+?\n\n", text, re.S) for text in texts]
    assert len(texts) == 3
    assert len({end[0] for end in ends if end}) == 1
    assert all(ends)


def test_the_page_s_figures_are_those_of_the_files() -> None:
    """Means over the last three evaluations of each training."""
    table = re.findall(r"^\| ([\w-]+) \|(( *-?[\d.]* *\|){6})$", (ROOT / "docs/baselines.md").read_text(), re.M)
    assert [name for name, *_ in table] == ["sac", "freemesh-train", "sb3_sac"]
    files = {path.stem: path for path in (FOLDER / "evaluations").glob("*.csv")}
    for name, cells, _ in table:
        told = [cell.strip() for cell in cells.split("|")[:6]]
        for i, seed in enumerate((356, 567, 999)):
            found = ["", ""]
            if (path := files.pop(f"{name}-{seed}", None)) is not None:
                with open(path, newline="") as file:
                    last = list(csv.DictReader(file))[-3:]
                means = [np.mean([float(row[key]) for row in last]) for key in ("return", "element_quality")]
                found = [f"{means[0]:.1f}", f"{means[1]:.2f}"]
            assert [told[i], told[i + 3]] == found, (name, seed)
    assert not files


def evaluations(folder: Path) -> list[dict[str, float]]:
    """The lines that a training wrote."""
    with open(folder / "evaluations.csv", newline="") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    assert all(list(row) == COLUMNS for row in rows)
    assert all(0 <= row["completion_rate"] <= 1 and 0 <= row["element_quality"] <= 1 for row in rows)
    return rows


@pytest.mark.slow
def test_stable_baselines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("stable_baselines3")
    import sb3_sac
    import torch

    made, found, states = sb3_sac.make_vec_env, [], []
    # Episodes that are cut off after a few steps.
    monkeypatch.setattr(
        sb3_sac, "make_vec_env",
        lambda name, env_kwargs, **rest: made(name, env_kwargs=env_kwargs | {"max_invalid": 2}, **rest),
    )  # fmt: skip
    evaluate = sb3_sac.evaluate

    def recorded(model: Any, *arguments: Any) -> dict[str, float]:
        states.append(torch.cat([p.detach().flatten() for p in model.policy.parameters()]))
        found.append(evaluate(model, *arguments))
        return found[-1]

    monkeypatch.setattr(sb3_sac, "evaluate", recorded)
    model = sb3_sac.train(sb3_sac.parse([*TINY, "--out", str(tmp_path)]))
    rows = evaluations(tmp_path)
    assert [row["env_steps"] for row in rows] == [16, 32, 48, 64]
    assert [row["updates"] for row in rows] == [0, 0, 8, 16]
    assert [{key: row[key] for key in COLUMNS[2:]} for row in rows] == found
    assert torch.equal(states[0], states[1])
    assert states[-1].isfinite().all()
    assert not torch.equal(states[0], states[-1])
    assert model.learning_rate == 3e-4
    assert model.ent_coef == "auto_0.1"

    # An episode that was cut off is none that ended: its last state has a value.
    buffer = model.replay_buffer
    assert buffer.timeouts[:16].sum() > 4
    ends = buffer.dones[:16] * (1 - buffer.timeouts[:16])
    assert ends.sum() == 0
    assert (buffer.next_observations[:15] != buffer.observations[1:16]).any(axis=2)[buffer.timeouts[:15] == 1].any()

    # The saved model in one environment, on its own, as far as its mean goes.
    saved = sb3_sac.SAC.load(tmp_path / "sac.zip", device="cpu")
    figures = evaluate(saved, "T1", 1, 5)
    torch.manual_seed(5)
    env, rejected, over, rewards = MeshEnv("T1"), False, False, 0.0
    obs = env.reset()[0]
    while not over:
        drawn, mean = (saved.predict(obs[None], deterministic=flag)[0][0] for flag in (False, True))
        obs, reward, terminated, truncated, info = env.step(drawn if rejected else mean)
        rejected, over, rewards = bool(info["rejection"]), terminated or truncated, rewards + reward
    assert figures["return"] == pytest.approx(rewards)
    assert (figures["elements"], figures["completion_rate"]) == (info["elements"], info["completed"])


#: In an interpreter of its own: nothing but the file itself may have told Gymnasium of the environment.
RLLIB = """
import json, sys
import numpy as np, torch
import rllib_sac
assert "envs" not in sys.modules
evaluate, states, acts = rllib_sac.evaluate, [], []
def recorded(module, *arguments):
    states.append(torch.cat([value.flatten() for value in module.state_dict().values()]))
    obs = np.random.default_rng(0).uniform(-1, 1, (3, 15)).astype(np.float32)
    with torch.no_grad():
        outputs = module.forward_inference({"obs": torch.from_numpy(obs)})["action_dist_inputs"]
    acts.append(np.abs(rllib_sac.act(module, obs, True) - np.tanh(outputs[:, :3].numpy())).max().item())
    return evaluate(module, *arguments)
rllib_sac.evaluate = recorded
learnt = rllib_sac.train(rllib_sac.parse(sys.argv[1:]))
print(json.dumps({
    "losses": [float(learnt[name]) for name in ("qf_loss", "policy_loss", "alpha_loss")],
    "updates": float(learnt["num_target_updates"]),
    "alpha": float(learnt["alpha_value"]),
    "equal": [torch.equal(states[0], state) for state in states],
    "finite": all(bool(state.isfinite().all()) for state in states),
    "acts": max(acts),
}))
"""


@pytest.mark.slow
def test_rllib(tmp_path: Path) -> None:
    out = tmp_path / "out"
    # Ray's sockets are in a folder with a short name.
    with tempfile.TemporaryDirectory(prefix="rl") as short:
        places = {"PYTHONPATH": os.pathsep.join([str(ROOT), str(FOLDER)]), "RAY_TMPDIR": short}
        process = subprocess.Popen(
            [sys.executable, "-c", RLLIB, *TINY, "--out", str(out)],
            cwd=tmp_path, env=outside() | places, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            start_new_session=True,
        )  # fmt: skip
        try:
            told, errors = process.communicate(timeout=300)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, 9)
                process.communicate()
    assert process.returncode == 0, errors
    found = json.loads(told.splitlines()[-1])
    rows = evaluations(out)
    assert [row["env_steps"] for row in rows] == [16, 32, 48, 64]
    assert [row["updates"] for row in rows] == [0, 2, 10, 18]
    assert found["updates"] == 18
    assert np.isfinite(found["losses"]).all()
    assert found["finite"]
    assert found["equal"] == [True, False, False, False]
    assert 0.09 < found["alpha"] < 0.1
    assert found["acts"] < 1e-6
    assert (out / "module.pt").stat().st_size > 100_000
