"""How fast it is here: environment, learner beside Stable-Baselines3, sampling, mesher, serving."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from envs.domain import from_rings, load
from envs.episodes import Episodes
from envs.random_domain import circle
from envs.types import Domain, MeshingParameters
from freemesh_ray import pendulum, plots
from freemesh_ray.local_ray import local_ray
from freemesh_ray.mesher import make
from freemesh_ray.policy import Policy
from freemesh_ray.serving import load as serving_load
from freemesh_ray.table import table

FRONTS = (50, 100, 200, 400, 800, 1600)
BATCH = 64
#: Learner and curve measurements: the domain, environments, and gradient steps for each env step, on both sides.
DOMAIN, ENVS, RATIO = "T1", 16, 0.5
FRAGMENTS = (8, 64, 256)
CURVE_SEEDS = (356, 567, 999)
CURVE_STEPS = 60_000
#: Env steps of each algorithm on Pendulum.
PENDULUM_STEPS = {"sac": 6_000, "td3": 10_000, "ddpg": 8_000, "ppo": 50_000}
#: Vertices of the discs and crosses that the mesher is timed on.
DISCS, CROSSES = (50, 100, 250, 500, 1000, 2000), (250, 500, 1000, 2000)


def run(parts: Sequence[str], *, seconds: float, folder: Path, policy: Policy) -> None:
    """Print the tables of the given parts.

    Args:
        parts: their names.
        seconds: of each measurement.
        folder: where ``curves`` writes to.
        policy: of ``mesher`` and ``serving``.
    """
    measurements: dict[str, Callable[[], None]] = {
        "env": lambda: bench_env(seconds),
        "learner": lambda: bench_learner(seconds),
        "sampling": lambda: bench_sampling(seconds),
        "mesher": lambda: bench_mesher(policy),
        "curves": lambda: bench_curves(folder),
        "algorithms": bench_algorithms,
        "serving": lambda: serving_load.bench({"given": policy}, seconds),
    }
    for part in parts:
        if part in ("learner", "curves", "algorithms") and find_spec("stable_baselines3") is None:
            print(f"{part}: skipped, Stable-Baselines3 is not installed (pip install stable-baselines3)")
            continue
        measurements[part]()
        print(flush=True)


def cross(n: int) -> Domain:
    """A Greek cross with about n even vertices (a front without corners could not be begun without type 2)."""
    corners = np.array(
        [(1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (2, 2), (2, 3), (1, 3), (1, 2), (0, 2), (0, 1), (1, 1)], dtype=float
    )
    share = np.arange(max(1, round(n / 12))) / max(1, round(n / 12))
    ends = np.roll(corners, -1, axis=0)
    sides = [start + share[:, None] * (end - start) for start, end in zip(corners, ends, strict=True)]
    return from_rings(np.concatenate(sides), name=f"cross{n}")


def valid_actions(domain: Domain, count: int, tries: int = 500) -> np.ndarray:
    """(m, 3), m <= count: actions that are all valid when taken from the start, found by trying at random.

    A front on which ``tries`` draws in a row are invalid is a dead end: the search begins anew, ten times at most, and
    the longest sequence counts.
    """
    episodes, random = Episodes([domain], MeshingParameters(max_invalid=tries), 1), np.random.default_rng(0)
    longest: list[np.ndarray] = []
    for _ in range(10):
        episodes.start(0, 0)
        found: list[np.ndarray] = []
        while len(found) < count:
            action = random.uniform(-1.0, 1.0, 3)
            out = episodes.step(action[None])
            if out.rejection[0] == 0:
                found.append(action)
            if out.terminated[0] or out.truncated[0]:
                break
        longest = max(longest, found, key=len)
        if len(longest) == count:
            break
    return np.array(longest)


def steps_per_second(domain: Domain, actions: Iterator[np.ndarray], restart_after: int, seconds: float) -> float:
    """Env steps a second of a batch, episodes begun anew after ``restart_after`` steps or at their end."""
    episodes = Episodes([domain], MeshingParameters(), BATCH)
    rounds, began = 0, time.perf_counter()
    while True:
        if rounds % restart_after == 0:
            for i in range(BATCH):
                episodes.start(i, 0)
            if rounds == 0:
                episodes.step(np.zeros((BATCH, 3)))  # compile
                for i in range(BATCH):
                    episodes.start(i, 0)
                began = time.perf_counter()
            elif time.perf_counter() - began > seconds:
                return rounds * BATCH / (time.perf_counter() - began)
        out = episodes.step(next(actions))
        for i in np.flatnonzero(out.terminated | out.truncated).tolist():
            episodes.start(i, 0)
        rounds += 1


def cycled(actions: np.ndarray) -> Iterator[np.ndarray]:
    """Each row for the whole batch, over and over."""
    batches = np.repeat(actions[:, None, :], BATCH, axis=1)
    while True:
        yield from batches


def bench_env(seconds: float) -> None:
    """Batched env steps a second against the front's length; every action valid, and actions drawn at random."""
    rows, speeds = [], []
    random = np.random.default_rng(0)
    for n in FRONTS:
        domain = cross(n)
        count = max(8, n // 8)  # so few that the front stays near its length
        sequence = valid_actions(domain, count)
        valid = steps_per_second(domain, cycled(sequence), len(sequence), seconds)
        drawn = steps_per_second(domain, cycled(random.uniform(-1.0, 1.0, (997, 3))), 200, seconds)
        speeds.append(valid)
        rows.append([str(len(domain.ring)), f"{valid:,.0f}", f"{drawn:,.0f}"])
    growth = np.polyfit(np.log(FRONTS), -np.log(speeds), 1)[0]
    print(f"environment, one core, batch of {BATCH}: env steps a second (a step's cost grows as front^{growth:.2f})")
    print(table(["front vertices", "valid actions", "random actions"], rows))


def disc(n: int) -> Domain:
    """A regular polygon of n vertices: a boundary without corners."""
    return from_rings(circle(n), name=f"disc{n}")


def bench_mesher(policy: Policy) -> None:
    """Elements a second of the mesher against the size of the mesh, raw and finished; the fastest of three."""
    rows, sizes, times = [], [], []
    for domain in [*map(disc, DISCS), *map(cross, CROSSES)]:
        # The first time compiles and touches the memory.
        made = min((make(policy, domain) for _ in range(4)), key=lambda one: one.seconds_finished)
        raw, finished = len(made.raw.quads), len(made.finished.quads)
        sizes.append(raw)
        times.append(made.seconds_finished)
        rows.append(
            [
                domain.name, f"{finished:,}", f"{raw / made.seconds_raw:,.0f}",
                f"{finished / made.seconds_finished:,.0f}", str(made.attempts), f"{made.detours:,}", f"{made.filled:,}",
            ]
        )  # fmt: skip
    growth = np.polyfit(np.log(sizes), np.log(times), 1)[0]
    print(f"mesher, one core (time grows as elements^{growth:.2f})")
    print(table(["domain", "elements", "raw, elements/s", "finished", "attempts", "detours", "filled"], rows))


def algorithm(runners: int, *, seed: int = 0, warmup: int = 1000, **training: Any) -> Any:
    """Our SAC on the measurement's domain."""
    from freemesh_ray.algorithms.environment import register
    from freemesh_ray.algorithms.sac import SACConfig

    options = {"domain": [load(DOMAIN)], **asdict(MeshingParameters())}
    return (
        SACConfig()
        .environment(register(), env_config=options)
        .env_runners(num_env_runners=runners, num_envs_per_env_runner=ENVS, rollout_fragment_length=8)
        .training(warmup_steps=warmup, updates_per_step=RATIO, **training)
        .debugging(seed=seed, log_level="ERROR")
        .build_algo()
    )


def stable_baselines(*, seed: int, warmup: int = 1000) -> Any:
    """Stable-Baselines3's SAC with the same numbers on the same environment; 8 steps of each env, then the updates."""
    import torch
    from stable_baselines3 import SAC

    from freemesh_ray.sb3_env import MeshVecEnv

    torch.set_num_threads(1)
    env = MeshVecEnv(load(DOMAIN), MeshingParameters(), ENVS)
    return SAC(
        "MlpPolicy", env, learning_rate=3e-4, buffer_size=1_000_000, learning_starts=warmup, batch_size=256, tau=5e-3,
        gamma=0.99, train_freq=8, gradient_steps=int(8 * ENVS * RATIO), policy_kwargs={"net_arch": [128, 128, 128]},
        seed=seed, device="cpu",
    )  # fmt: skip


def our_updates_per_second(seconds: float) -> float:
    """Whole training rounds: sampling, storing, updating, publishing weights."""
    algo = algorithm(0)
    while algo.updates == 0:
        algo.training_step()
    updates, began = algo.updates, time.perf_counter()
    while time.perf_counter() - began < seconds:
        algo.training_step()
    speed = (algo.updates - updates) / (time.perf_counter() - began)
    algo.stop()
    return speed


def their_updates_per_second(seconds: float) -> float:
    """The same of Stable-Baselines3."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Clock(BaseCallback):
        began, updates = 0.0, 0

        def _on_rollout_start(self) -> None:
            if self.model._n_updates and not self.began:
                self.began, self.updates = time.perf_counter(), self.model._n_updates

        def _on_step(self) -> bool:
            return not self.began or time.perf_counter() - self.began < seconds

    model, clock = stable_baselines(seed=0), Clock()
    model.learn(10**9, callback=clock)
    return (model._n_updates - clock.updates) / (time.perf_counter() - clock.began)


def bench_learner(seconds: float) -> None:
    """Updates a second of whole training rounds, ours and Stable-Baselines3's in turn, three times each."""
    with local_ray(0):
        pairs = [(our_updates_per_second(seconds), their_updates_per_second(seconds)) for _ in range(3)]
    rows = [[f"run {i + 1}", f"{a:.0f}", f"{b:.0f}", f"{a / b:.2f}"] for i, (a, b) in enumerate(pairs)]
    ratio = float(np.median([a / b for a, b in pairs]))
    print(f"learner, one thread, {DOMAIN}, {RATIO} updates a step: updates a second (median ratio {ratio:.2f})")
    print(table(["", "freemesh-ray", "Stable-Baselines3", "ratio"], rows))


def bench_sampling(seconds: float) -> None:
    """Transitions a second with 0, 1 and 2 env runners, policy included, and with what larger fragments give."""
    rows = []
    for runners in (0, 1, 2):
        with local_ray(runners):
            algo = algorithm(runners)
            speeds = []
            for fragment in FRAGMENTS:
                algo.config._is_frozen = False
                algo.config.rollout_fragment_length = fragment
                warm = time.perf_counter()
                while time.perf_counter() - warm < seconds:  # new processes are slow at first
                    algo._collect(uniform=False)
                count, began = 0, time.perf_counter()
                while time.perf_counter() - began < seconds:
                    count += sum(len(part.transitions) for part in algo._collect(uniform=False))
                speeds.append(count / (time.perf_counter() - began))
            algo.stop()
        rows.append([str(runners), *(f"{speed:,.0f}" for speed in speeds)])
    print(f"sampling, {ENVS} environments a runner: transitions a second, to the learner's process")
    print(table(["env runners", *(f"{steps} steps a round" for steps in FRAGMENTS)], rows))


def bench_algorithms() -> None:
    """What each algorithm has learnt of Pendulum, ours and Stable-Baselines3's in turn: same numbers, three seeds."""
    rows = []
    for name, steps in PENDULUM_STEPS.items():
        pairs = []
        for seed in CURVE_SEEDS:
            with local_ray(0):
                own = pendulum.our_training(name, seed, steps)
            pairs.append((own, pendulum.their_training(name, seed, steps)))
            print(f"{name}, seed {seed}: done", file=sys.stderr, flush=True)
        scores = [" ".join(f"{one[side][0]:.0f}" for one in pairs) for side in (0, 1)]
        ratio = float(np.median([theirs[1] / ours[1] for ours, theirs in pairs]))
        rows.append([name, f"{steps:,}", *scores, f"{ratio:.1f}"])
    print(f"algorithms on Pendulum: mean return of {pendulum.EPISODES} episodes, {len(CURVE_SEEDS)} seeds")
    print(table(["", "env steps", "freemesh-ray", "Stable-Baselines3", "times as fast"], rows))


def bench_curves(folder: Path) -> None:
    """Learning curves, ours and Stable-Baselines3's: same environment, same numbers, three seeds each."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Returns(BaseCallback):
        def __init__(self) -> None:
            super().__init__()
            self.ended: list[tuple[int, float]] = []

        def _on_step(self) -> bool:
            self.ended += [
                (self.num_timesteps, info["episode"]["r"]) for info in self.locals["infos"] if "episode" in info
            ]
            return True

    folder.mkdir(parents=True, exist_ok=True)
    ended: dict[str, list[list[tuple[int, float]]]] = {"freemesh-ray": [], "Stable-Baselines3": []}
    for seed in CURVE_SEEDS:
        with local_ray(0):
            algo, own = algorithm(0, seed=seed, warmup=5000), []
            while algo.env_steps < CURVE_STEPS:
                algo.training_step()
                own += [(algo.env_steps, episode.episode_return) for episode in algo.finished]
                algo.finished.clear()
            algo.stop()
        ended["freemesh-ray"].append(own)
        model, returns = stable_baselines(seed=seed, warmup=5000), Returns()
        model.learn(CURVE_STEPS, callback=returns)
        ended["Stable-Baselines3"].append(returns.ended)
        print(f"seed {seed}: done", file=sys.stderr, flush=True)
    edges = np.arange(0, CURVE_STEPS + 1, CURVE_STEPS // 15)
    curves = {label: np.array([binned(run, edges) for run in runs]) for label, runs in ended.items()}
    (folder / "curves.json").write_text(
        json.dumps({"steps": edges[1:].tolist(), **{label: values.tolist() for label, values in curves.items()}})
    )
    plots.draw_curves(
        {label: [(edges[1:], one) for one in values] for label, values in curves.items()}, folder / "curves.png",
        xlabel="environment steps", ylabel="return of a training episode",
        title=f"SAC on {DOMAIN}, {RATIO} updates a step, {len(CURVE_SEEDS)} seeds",
    )  # fmt: skip
    rows = [
        [
            f"{edges[i + 1]:,}",
            *(f"{curves[label][:, i].mean():.1f} ± {curves[label][:, i].std():.1f}" for label in curves),
        ]
        for i in range(2, len(edges) - 1, 3)
    ]
    print(
        f"learning curves on {DOMAIN}: return of training episodes, {len(CURVE_SEEDS)} seeds -> {folder / 'curves.png'}"
    )
    print(table(["env steps", *curves], rows))


def binned(ended: list[tuple[int, float]], edges: np.ndarray) -> list[float]:
    """Mean return of the episodes that ended between consecutive edges; nan where none did."""
    steps, returns = np.array(ended).T
    means = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        inside = returns[(steps > low) & (steps <= high)]
        means.append(float(inside.mean()) if len(inside) else float("nan"))
    return means
