"""Env steps a second against the length of the front, on domains made as large as a measurement wants them."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from envs.domains.load import from_rings
from envs.mdp.episodes import Episodes
from envs.types import Domain, MeshingParameters
from freemesh_ray.formatting.table import table
from freemesh_ray.formatting.terminal import say

FRONTS = (50, 100, 200, 400, 800, 1600)
BATCH = 64


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


def run(seconds: float) -> None:
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
    say(f"environment, one core, batch of {BATCH}: env steps a second (a step's cost grows as front^{growth:.2f})")
    say(table(["front vertices", "valid actions", "random actions"], rows))
