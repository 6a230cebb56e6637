"""SAC on FreeMesh-v0 in one file: Gymnasium, NumPy and PyTorch, nothing else (Haarnoja et al. 2018b).

    .venv/bin/python docs/examples/baselines/sac.py --domain T1 --steps 30000 --seed 356 --out baseline

Its settings are those of tune_configs/defaults.yaml. Written to --out: `evaluations.csv`, a line for each evaluation,
and `actor.pt`, the state of the policy network.
"""

from __future__ import annotations

import argparse
import copy
import csv
import math
import time
from collections import deque
from pathlib import Path
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

ENV = "envs:FreeMesh-v0"  # the package `envs`, which registers it, and the environment
HIDDEN, LOG_STD_MIN, LOG_STD_MAX = (128, 128, 128), -20.0, 2.0
COLUMNS = ["env_steps", "updates", "return", "completion_rate", "elements", "element_quality"]


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="SAC on FreeMesh-v0")
    parser.add_argument("--domain", default="T1", help="a catalogue name, a polygon file or random-SEED")
    parser.add_argument("--steps", type=int, default=100_000, help="env steps of the training")
    parser.add_argument("--seed", type=int, default=356)
    parser.add_argument("--out", type=Path, default=Path("baseline"), help="folder of the results")
    parser.add_argument("--envs", type=int, default=16, help="environments stepped together")
    parser.add_argument("--warmup", type=int, default=5000, help="env steps of random actions before the first update")
    parser.add_argument("--updates-per-step", type=float, default=0.5)
    parser.add_argument("--batch-size", type=int, default=256)
    parser.add_argument("--gamma", type=float, default=0.99, help="discount")
    parser.add_argument("--tau", type=float, default=0.005, help="share that a target takes over in an update")
    parser.add_argument("--lr", type=float, default=3e-4, help="learning rate of everything")
    parser.add_argument("--alpha", type=float, default=0.1, help="temperature at the start")
    parser.add_argument("--print-every", type=int, default=1000, help="env steps between lines")
    parser.add_argument("--eval-every", type=int, default=10_000, help="env steps between evaluations")
    parser.add_argument("--eval-episodes", type=int, default=10)
    args = parser.parse_args(arguments)
    try:
        gym.make(ENV, domain=args.domain)
        args.out.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    return args


def mlp(inputs: int, outputs: int) -> nn.Sequential:
    sizes = (inputs, *HIDDEN)
    hidden = [layer for i, o in zip(sizes, HIDDEN, strict=False) for layer in (nn.Linear(i, o), nn.ReLU())]
    return nn.Sequential(*hidden, nn.Linear(HIDDEN[-1], outputs))


class Actor(nn.Module):
    """A Gaussian squashed by tanh: observations (B, o) to actions (B, a) in (-1, 1)."""

    def __init__(self, observations: int, actions: int) -> None:
        super().__init__()
        self.net = mlp(observations, 2 * actions)

    def sample(self, obs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions drawn, and log pi of each, (B,)."""
        mean, log_std = self.net(obs).chunk(2, dim=-1)
        log_std = log_std.clamp(LOG_STD_MIN, LOG_STD_MAX)
        noise = torch.randn_like(mean)
        u = mean + log_std.exp() * noise
        log_normal = -0.5 * noise.square() - log_std - 0.5 * math.log(2 * math.pi)
        log_slope = 2 * (math.log(2) - u - F.softplus(-2 * u))  # log(1 - tanh(u)^2), which does not overflow
        return u.tanh(), (log_normal - log_slope).sum(dim=-1)

    def mean(self, obs: torch.Tensor) -> torch.Tensor:
        return self.net(obs).chunk(2, dim=-1)[0].tanh()


class Critics(nn.Module):
    """Two networks: observations (B, o) and actions (B, a) to values (2, B)."""

    def __init__(self, observations: int, actions: int) -> None:
        super().__init__()
        self.nets = nn.ModuleList(mlp(observations + actions, 1) for _ in range(2))

    def forward(self, obs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        inputs = torch.cat([obs, actions], dim=-1)
        return torch.stack([net(inputs).squeeze(-1) for net in self.nets])


class Batch(NamedTuple):
    """Transitions. `terminated` is 1 where the mesh was completed; a truncated episode has a next state's value."""

    obs: torch.Tensor
    actions: torch.Tensor
    rewards: torch.Tensor
    next_obs: torch.Tensor
    terminated: torch.Tensor


class ReplayBuffer:
    """The last `capacity` transitions."""

    def __init__(self, capacity: int, observations: int, actions: int) -> None:
        sizes = ((observations,), (actions,), (), (observations,), ())
        self.rows = Batch(*(torch.zeros(capacity, *size) for size in sizes))
        self.capacity, self.added = capacity, 0

    def __len__(self) -> int:
        return min(self.added, self.capacity)

    def add(self, *columns: np.ndarray) -> None:
        where = (self.added + torch.arange(len(columns[0]))) % self.capacity
        for row, column in zip(self.rows, columns, strict=True):
            row[where] = torch.as_tensor(column, dtype=torch.float32)
        self.added += len(columns[0])

    def sample(self, size: int) -> Batch:
        where = torch.randint(len(self), (size,))
        return Batch(*(row[where] for row in self.rows))


class SAC:
    """Networks, temperature, and their update."""

    def __init__(self, observations: int, actions: int, args: argparse.Namespace) -> None:
        self.gamma, self.tau, self.target_entropy = args.gamma, args.tau, -float(actions)
        self.actor = Actor(observations, actions)
        self.critics = Critics(observations, actions)
        self.targets = copy.deepcopy(self.critics).requires_grad_(False)
        self.log_alpha = torch.tensor(math.log(args.alpha), requires_grad=True)
        self.actor_adam = torch.optim.Adam(self.actor.parameters(), lr=args.lr, fused=True)
        self.critic_adam = torch.optim.Adam(self.critics.parameters(), lr=args.lr, fused=True)
        self.alpha_adam = torch.optim.Adam([self.log_alpha], lr=args.lr)

    @torch.no_grad()
    def act(self, obs: np.ndarray, deterministic: bool = False) -> np.ndarray:
        inputs = torch.from_numpy(obs)
        return (self.actor.mean(inputs) if deterministic else self.actor.sample(inputs)[0]).numpy()

    @torch.no_grad()
    def bellman_target(self, batch: Batch) -> torch.Tensor:
        """Rewards, and the soft value of the next state where there is one; (B,)."""
        next_actions, next_log_pi = self.actor.sample(batch.next_obs)
        next_value = self.targets(batch.next_obs, next_actions).amin(dim=0) - self.log_alpha.exp() * next_log_pi
        return batch.rewards + self.gamma * (1 - batch.terminated) * next_value

    def update(self, batch: Batch) -> dict[str, float]:
        """One gradient step of temperature, critics and actor, in this order; then the targets follow."""
        alpha = self.log_alpha.exp().detach()
        actions, log_pi = self.actor.sample(batch.obs)
        target = self.bellman_target(batch)
        alpha_loss = -(self.log_alpha * (log_pi.detach() + self.target_entropy)).mean()
        descend(self.alpha_adam, alpha_loss)
        critic_loss = 0.5 * (self.critics(batch.obs, batch.actions) - target).square().mean(dim=1).sum()
        descend(self.critic_adam, critic_loss)
        self.critics.requires_grad_(False)
        actor_loss = (alpha * log_pi - self.critics(batch.obs, actions).amin(dim=0)).mean()
        descend(self.actor_adam, actor_loss)
        self.critics.requires_grad_(True)
        with torch.no_grad():
            for slow, fast in zip(self.targets.parameters(), self.critics.parameters(), strict=True):
                slow.lerp_(fast, self.tau)
        return {"critic_loss": critic_loss.item(), "actor_loss": actor_loss.item(), "alpha_loss": alpha_loss.item()}


def descend(optimizer: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


def evaluate(agent: SAC, domain: str, episodes: int, seed: int) -> dict[str, float]:
    """Means over whole episodes of the squashed mean; an action is drawn only where the last was rejected, since the
    front is unchanged and the mean would be rejected again. The training's random numbers are left as they are."""
    envs = gym.make_vec(ENV, num_envs=episodes, domain=domain)
    over, rejected = np.zeros(episodes, dtype=bool), np.zeros(episodes, dtype=bool)
    returns, completed, elements, quality = np.zeros((4, episodes))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        obs, _ = envs.reset(seed=seed)
        while not over.all():
            actions = np.where(rejected[:, None], agent.act(obs), agent.act(obs, deterministic=True))
            obs, rewards, terminated, truncated, info = envs.step(actions)
            returns += np.where(over, 0.0, rewards)
            rejected = info["rejection"] != ""
            for i in np.flatnonzero((terminated | truncated) & ~over):
                completed[i], elements[i], quality[i] = terminated[i], info["elements"][i], info["mean_eta"][i]
            over |= terminated | truncated
    envs.close()
    return dict(zip(COLUMNS[2:], (float(x.mean()) for x in (returns, completed, elements, quality)), strict=True))


def train(args: argparse.Namespace) -> tuple[SAC, ReplayBuffer]:
    """The whole run: `args.steps` env steps, its evaluations and its files."""
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    envs = gym.make_vec(ENV, num_envs=args.envs, domain=args.domain)
    assert envs.metadata["autoreset_mode"] == gym.vector.AutoresetMode.NEXT_STEP
    envs.action_space.seed(args.seed)
    observations, actions = map(gym.spaces.flatdim, (envs.single_observation_space, envs.single_action_space))
    agent, buffer = SAC(observations, actions, args), ReplayBuffer(args.steps + args.envs, observations, actions)

    with open(args.out / "evaluations.csv", "w", newline="") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        obs, _ = envs.reset(seed=args.seed)
        ended, returns = np.zeros(args.envs, dtype=bool), np.zeros(args.envs)
        latest: deque[tuple[float, bool]] = deque(maxlen=50)  # return of an episode, and whether it was completed
        steps, updates, losses, told, began = 0, 0, {}, 0, time.perf_counter()
        while steps < args.steps:
            chosen = envs.action_space.sample() if steps < args.warmup else agent.act(obs)
            next_obs, rewards, terminated, truncated, _ = envs.step(chosen)
            # The step after an episode's end only begins the next one: it is no transition. The observation of the
            # step before is the true last one, and its value counts where the episode was truncated, not terminated.
            taken = ~ended
            buffer.add(*(x[taken] for x in (obs, chosen, rewards, next_obs, terminated)))
            before, steps, returns = steps, steps + int(taken.sum()), returns + rewards
            obs, ended = next_obs, terminated | truncated
            latest.extend(zip(returns[ended], terminated[ended], strict=True))
            returns[ended] = 0.0
            if steps > args.warmup:
                for _ in range(int((steps - args.warmup) * args.updates_per_step) - updates):
                    losses = agent.update(buffer.sample(args.batch_size))
                    updates += 1
            if steps // args.print_every > before // args.print_every:
                mean, rate = np.mean(latest, axis=0) if latest else (math.nan, math.nan)
                speed = (updates - told) / (time.perf_counter() - began)
                tail = "".join(f"  {name} {value:.3f}" for name, value in losses.items())
                print(f"step {steps}  return {mean:.2f}  completed {rate:.2f}  updates/s {speed:.0f}{tail}", flush=True)
                told, began = updates, time.perf_counter()
            if steps // args.eval_every > before // args.eval_every or steps >= args.steps:
                figures = evaluate(agent, args.domain, args.eval_episodes, args.seed)
                table.writerow({"env_steps": steps, "updates": updates, **figures})
                file.flush()
                print("evaluation  " + "  ".join(f"{key} {value:.2f}" for key, value in figures.items()), flush=True)
    envs.close()
    torch.save(agent.actor.state_dict(), args.out / "actor.pt")
    return agent, buffer


if __name__ == "__main__":
    train(parse())
