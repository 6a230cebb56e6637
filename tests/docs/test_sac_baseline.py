"""`docs/examples/baselines/sac.py`: its step against a textbook's, its buffer against single environments."""

from __future__ import annotations

import ast
import csv
import json
import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import sac
import torch
from checkout import ROOT
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from torch.nn import functional as F

from envs.mesh_env import MeshEnv

FILE = ROOT / "docs/examples/baselines/sac.py"
OBS, ACT, BATCH = 15, 3, 32
Weights = dict[str, torch.Tensor]


def test_it_is_one_short_file_that_needs_little() -> None:
    text = FILE.read_text()
    imported = {
        name.partition(".")[0]
        for node in ast.walk(ast.parse(text))
        for name in (
            [alias.name for alias in node.names] if isinstance(node, ast.Import)
            else [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        )
    }  # fmt: skip
    assert imported - set(sys.stdlib_module_names) == {"gymnasium", "numpy", "torch"}
    assert len(text.splitlines()) <= 250


@pytest.fixture
def doubles() -> Iterator[None]:
    """Tensors are float64."""
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


def random_batch(terminated: float | None = None) -> sac.Batch:
    flags = (torch.rand(BATCH) < 0.3).to(torch.get_default_dtype())
    return sac.Batch(
        obs=torch.randn(BATCH, OBS),
        actions=torch.rand(BATCH, ACT) * 2 - 1,
        rewards=torch.randn(BATCH),
        next_obs=torch.randn(BATCH, OBS),
        terminated=flags if terminated is None else torch.full((BATCH,), terminated),
    )


def forward(weights: Weights, prefix: str, x: torch.Tensor) -> torch.Tensor:
    """A network with ReLU between its layers, by the names of its weights."""
    names = sorted(name for name in weights if name.startswith(prefix) and name.endswith("weight"))
    for name in names:
        x = x @ weights[name].T + weights[name.replace("weight", "bias")]
        x = x if name == names[-1] else x.clamp(min=0)
    return x


def draw(actor: Weights, obs: torch.Tensor, noise: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Actions and log densities, by PyTorch's own distributions."""
    mean, log_std = forward(actor, "net", obs).chunk(2, dim=1)
    normal = torch.distributions.Normal(mean, log_std.clamp(-20, 2).exp())
    u = mean + normal.scale * noise
    return u.tanh(), (normal.log_prob(u) - torch.log(1 - u.tanh() ** 2)).sum(dim=1)


class Textbook:
    """SAC as in Haarnoja et al. 2018b, with Kingma and Ba's Adam, on a copy of an agent's weights."""

    def __init__(self, agent: sac.SAC, learning_rate: float) -> None:
        def copied(module: torch.nn.Module) -> Weights:
            return {name: value.clone().requires_grad_() for name, value in module.state_dict().items()}

        self.actor, self.critics, self.targets = (copied(m) for m in (agent.actor, agent.critics, agent.targets))
        self.log_alpha = {"log_alpha": agent.log_alpha.detach().clone().requires_grad_()}
        self.learning_rate, self.t = learning_rate, 0
        self.moments: dict[int, tuple[torch.Tensor, torch.Tensor]] = {}

    def adam(self, weights: Weights, loss: torch.Tensor) -> None:
        gradients = torch.autograd.grad(loss, list(weights.values()))
        for weight, gradient in zip(weights.values(), gradients, strict=True):
            zeros = torch.zeros_like(gradient)
            m, v = self.moments.get(id(weight), (zeros, zeros))
            m, v = 0.9 * m + 0.1 * gradient, 0.999 * v + 0.001 * gradient**2
            self.moments[id(weight)] = m, v
            with torch.no_grad():
                weight -= self.learning_rate * (m / (1 - 0.9**self.t)) / ((v / (1 - 0.999**self.t)).sqrt() + 1e-8)

    def q(self, weights: Weights, obs: torch.Tensor, actions: torch.Tensor) -> list[torch.Tensor]:
        return [forward(weights, f"nets.{i}.", torch.cat([obs, actions], dim=1))[:, 0] for i in range(2)]

    def update(self, batch: sac.Batch, noise: torch.Tensor, gamma: float, tau: float) -> None:
        self.t += 1
        alpha = math.exp(self.log_alpha["log_alpha"].item())
        actions, log_pi = draw(self.actor, batch.obs, noise[0])
        next_actions, next_log_pi = draw(self.actor, batch.next_obs, noise[1])
        following = torch.minimum(*self.q(self.targets, batch.next_obs, next_actions)) - alpha * next_log_pi
        target = torch.where(batch.terminated == 1, batch.rewards, batch.rewards + gamma * following).detach()

        self.adam(self.log_alpha, -(self.log_alpha["log_alpha"] * (log_pi.detach() - ACT)).mean())
        first, second = self.q(self.critics, batch.obs, batch.actions)
        self.adam(self.critics, ((first - target) ** 2).mean() / 2 + ((second - target) ** 2).mean() / 2)
        self.adam(self.actor, (alpha * log_pi - torch.minimum(*self.q(self.critics, batch.obs, actions))).mean())
        for name, value in self.targets.items():
            self.targets[name] = (tau * self.critics[name] + (1 - tau) * value).detach()


def agent_of(*arguments: str) -> sac.SAC:
    return sac.SAC(OBS, ACT, sac.parse([*arguments]))


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`parse` makes the folder of the results."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("doubles")
def test_updates_are_a_textbook_s() -> None:
    torch.manual_seed(1)
    agent = agent_of("--tau", "0.1", "--gamma", "0.9", "--lr", "0.001")
    book, start = Textbook(agent, 0.001), [p.detach().clone() for p in agent.actor.parameters()]
    for k in range(6):
        batch = random_batch()
        torch.manual_seed(k)
        noise = torch.stack([torch.randn(BATCH, ACT), torch.randn(BATCH, ACT)])
        torch.manual_seed(k)
        losses = agent.update(batch)
        book.update(batch, noise, gamma=0.9, tau=0.1)
        assert all(math.isfinite(loss) for loss in losses.values())
    compared = 0
    for ours, theirs in ((agent.actor, book.actor), (agent.critics, book.critics), (agent.targets, book.targets)):
        for name, value in ours.state_dict().items():
            torch.testing.assert_close(value, theirs[name], rtol=1e-8, atol=1e-10, check_dtype=False)
            compared += value.numel()
    torch.testing.assert_close(agent.log_alpha, book.log_alpha["log_alpha"], rtol=1e-10, atol=0)
    assert compared > 100_000
    assert all((new - old).abs().max() > 1e-4 for new, old in zip(agent.actor.parameters(), start, strict=True))


def test_targets_move_by_tau() -> None:
    agent = agent_of("--tau", "0.25", "--lr", "0.01")
    before = [p.clone() for p in agent.targets.parameters()]
    agent.update(random_batch())
    for old, new, critic in zip(before, agent.targets.parameters(), agent.critics.parameters(), strict=True):
        torch.testing.assert_close(new, old + 0.25 * (critic - old))
        assert not torch.equal(new, old)


def test_only_a_terminated_transition_has_no_future() -> None:
    agent = agent_of()
    for terminated in (1.0, 0.0):
        batch = random_batch(terminated)
        with torch.no_grad():
            for bias in (net[-1].bias for net in agent.targets.nets):
                bias.fill_(100.0)  # of every next state
        future = agent.bellman_target(batch) - batch.rewards
        assert (future == 0).all() if terminated else (future > 90).all()


HEXAGON = [[0, 0], [2, 0], [3, 1], [2, 2], [0, 2], [-1, 1]]


@pytest.fixture
def hexagon(tmp_path: Path) -> str:
    """Two elements fill it, so that random actions complete it now and then."""
    path = tmp_path / "hexagon.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [[*HEXAGON, HEXAGON[0]]]}))
    return str(path)


def test_the_buffer_holds_what_single_environments_do(hexagon: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each transition, no step that only begins an episode, and `terminated` of completed meshes alone."""
    envs, made = 3, gym.make_vec
    options = {"domain": hexagon, "max_invalid": 4}
    monkeypatch.setattr(gym, "make_vec", lambda name, **given: made(name, **given | options))
    _, buffer = sac.train(sac.parse(["--domain", hexagon, "--envs", str(envs), "--steps", "600", "--warmup", "900"]))
    singles, ends = [MeshEnv(**options) for _ in range(envs)], {"terminated": 0, "truncated": 0}
    now = [env.reset()[0] for env in singles]
    rows = [column[: len(buffer)].numpy() for column in buffer.rows]
    row, idle = 0, set[int]()
    assert len(buffer) >= 600
    while row < len(buffer):
        beginning, idle = idle, set()
        for i in range(envs):
            if i in beginning:
                now[i] = singles[i].reset()[0]
                continue
            obs, action, reward, next_obs, terminated = (column[row] for column in rows)
            np.testing.assert_array_equal(obs, now[i])
            found = singles[i].step(action)
            np.testing.assert_array_equal(next_obs, found[0])
            assert reward == np.float32(found[1])
            assert bool(terminated) == found[2] == found[4].get("completed", False)
            now[i], row = found[0], row + 1
            if found[2] or found[3]:
                idle.add(i)
                ends["terminated" if found[2] else "truncated"] += 1
    assert min(ends.values()) > 5, ends


def test_a_full_buffer_forgets_the_oldest() -> None:
    buffer = sac.ReplayBuffer(5, 1, 1)
    for k in range(4):
        one = np.arange(2 * k, 2 * k + 2)
        buffer.add(one[:, None], one[:, None], one, one[:, None], one)
    assert len(buffer) == 5
    assert sorted(buffer.rows.rewards.tolist()) == [3, 4, 5, 6, 7]
    assert set(buffer.sample(200).rewards.tolist()) == {3, 4, 5, 6, 7}
    batch = buffer.sample(50)
    assert torch.equal(batch.obs[:, 0], batch.rewards)


def test_the_mean_is_squashed_and_densities_integrate_to_one() -> None:
    agent = sac.Actor(2, 1)
    obs = torch.zeros(40_000, 2)
    torch.manual_seed(0)
    with torch.no_grad():
        drawn, log_pi = agent.sample(obs)
        mean = F.linear(agent.net[:-1](obs[:1]), agent.net[-1].weight, agent.net[-1].bias)[0, 0].tanh()
    assert torch.equal(agent.mean(obs[:1]).detach()[0], mean[None])
    assert drawn.abs().max() <= 1
    # E[1 / pi(a)] is the length of (-1, 1) where pi has support.
    assert torch.exp(-log_pi).clamp(max=100).mean() == pytest.approx(2.0, rel=0.1)


def train(out: str, *arguments: str) -> tuple[sac.SAC, list[dict[str, float]]]:
    options = ["--steps", "200", "--warmup", "100", "--eval-every", "100", "--eval-episodes", "2", "--out", out]
    agent, _ = sac.train(sac.parse([*options, *arguments]))
    with open(f"{out}/evaluations.csv", newline="") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    return agent, rows


def test_a_training_leaves_its_evaluations_and_the_network(capsys: pytest.CaptureFixture[str]) -> None:
    agent, rows = train("first", "--print-every", "50")
    assert [list(row) for row in rows] == [sac.COLUMNS] * 2
    assert [row["env_steps"] for row in rows] == [112, 208]
    assert [row["updates"] for row in rows] == [6, 54]
    losses = re.findall(r"_loss (\S+)", printed := capsys.readouterr().out)
    assert len(re.findall(r"^step \d+  return \S+  completed \S+  updates/s \d+", printed, re.M)) == 4
    assert losses
    assert all(math.isfinite(float(loss)) for loss in losses)

    # The last line once more: the saved network in one environment, on its own
    saved = sac.Actor(OBS, ACT)
    saved.load_state_dict(torch.load("first/actor.pt", weights_only=True))
    assert all(torch.equal(a, b) for a, b in zip(saved.parameters(), agent.actor.parameters(), strict=True))
    figures = sac.evaluate(agent, "T1", 1, 5)
    torch.manual_seed(5)
    env, rejected, rewards = MeshEnv("T1"), False, []
    obs, over = env.reset()[0], False
    while not over:
        inputs = torch.from_numpy(obs[None])
        with torch.no_grad():
            drawn = saved.sample(inputs)[0]
            action = drawn if rejected else saved.mean(inputs)
        obs, reward, terminated, truncated, info = env.step(action[0].numpy())
        rejected, over = bool(info["rejection"]), terminated or truncated
        rewards.append(reward)
    assert figures == pytest.approx(
        {
            "return": sum(rewards), "completion_rate": float(info["completed"]), "elements": info["elements"],
            "element_quality": info["mean_eta"],
        }
    )  # fmt: skip


def test_an_evaluation_is_each_environment_s_first_episode(hexagon: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which end at different times; Gymnasium counts, too."""
    made, first = gym.make_vec, dict[int, tuple[float, int]]()

    class Recorded(RecordEpisodeStatistics):
        def step(self, actions: np.ndarray) -> tuple[Any, ...]:
            result = super().step(actions)
            for i in np.flatnonzero(result[4].get("_episode", [])).tolist():
                first.setdefault(i, (result[4]["episode"]["r"][i], result[4]["episode"]["l"][i]))
            return result

    monkeypatch.setattr(gym, "make_vec", lambda *names, **options: Recorded(made(*names, **options)))
    figures = sac.evaluate(agent_of(), hexagon, 6, 3)
    returns, lengths = zip(*(first[i] for i in range(6)), strict=True)
    assert figures["return"] == pytest.approx(np.mean(returns), rel=1e-5)
    assert len(set(lengths)) > 1


@pytest.mark.slow
def test_one_seed_one_training() -> None:
    """And evaluations leave it as it is."""
    first, again = train("first")[0], train("again")[0]
    assert Path("first/evaluations.csv").read_bytes() == Path("again/evaluations.csv").read_bytes()
    seldom = train("seldom", "--eval-every", "1000")[0]
    other = train("other", "--seed", "7")[0]
    weights = [torch.cat([p.flatten() for p in agent.actor.parameters()]) for agent in (first, again, seldom, other)]
    assert torch.equal(weights[0], weights[1])
    assert torch.equal(weights[0], weights[2])
    assert not torch.equal(weights[0], weights[3])


@pytest.mark.parametrize("arguments", [["--domain", "nowhere"], ["--out", "/proc/self/status/here"]])
def test_it_refuses_in_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        sac.parse(arguments)
    assert ended.value.code == 2
    assert re.search(r"error: .*(nowhere|/proc/self/status)", capsys.readouterr().err.splitlines()[-1])
