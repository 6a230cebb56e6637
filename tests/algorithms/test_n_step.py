"""n-step returns against sums over whole episodes, and against Stable-Baselines3's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray.algorithms.n_step import NStepReturns
from freemesh_ray.algorithms.replay_buffer import Transitions, concatenate

GAMMA = 0.9


def played(lengths: list[list[int]], steps: int) -> list[list[dict[str, Any]]]:
    """Episodes of given lengths in every environment, as steps with numbered observations, in the order of time.

    Every second episode is truncated. After an end there is a step without a transition, as environments that reset in
    the next step have it; the last episode of each environment goes on beyond ``steps``.
    """
    environments = []
    for i, planned in enumerate(lengths):
        taken: list[dict[str, Any]] = []
        for episode, length in enumerate([*planned, steps + 1]):
            for t in range(length):
                last = t == length - 1
                number = 1000.0 * i + len(taken)
                taken.append({
                    "episode": episode, "obs": number, "reward": np.sin(number), "next_obs": number + 0.5,
                    "terminated": last and episode % 2 == 0, "truncated": last and episode % 2 == 1,
                })  # fmt: skip
            taken.append({})
        environments.append(taken[:steps])
    return environments


def fed(returns: NStepReturns, environments: list[list[dict[str, Any]]], first: int, end: int) -> list[Transitions]:
    """What the steps from ``first`` to ``end`` complete."""
    complete = []
    for t in range(first, end):
        now = [taken[t] for taken in environments]
        live = np.array([bool(step) for step in now])
        rows = [step for step in now if step]

        def column(key: str, rows: list[dict[str, Any]] = rows) -> np.ndarray:
            return np.array([row[key] for row in rows], dtype=np.float32)

        step = Transitions(
            column("obs")[:, None], column("obs")[:, None] + 0.25, column("reward"), column("next_obs")[:, None],
            column("terminated"), np.ones(len(rows), dtype=np.float32),
        )  # fmt: skip
        ended = np.array([bool(one.get("terminated") or one.get("truncated")) for one in now])
        if live.any():
            complete.append(returns.add(live, step, ended))
    return complete


def expected(environments: list[list[dict[str, Any]]], n: int) -> dict[float, tuple[float, ...]]:
    """Return, next observation, terminated and steps of each step whose n-step return is known, by its observation."""
    found = {}
    for taken in environments:
        for t, start in enumerate(taken):
            ahead = [step for step in taken[t : t + n] if step and start and step["episode"] == start["episode"]]
            if ahead and (len(ahead) == n or ahead[-1]["terminated"] or ahead[-1]["truncated"]):
                total = sum(GAMMA**k * step["reward"] for k, step in enumerate(ahead))
                found[start["obs"]] = (total, ahead[-1]["next_obs"], float(ahead[-1]["terminated"]), len(ahead))
    return found


@given(
    st.integers(1, 5),
    st.lists(st.lists(st.integers(1, 8), max_size=4), min_size=1, max_size=4),
    st.integers(1, 25),
    st.integers(0, 25),
)
def test_they_are_the_episodes_sums(n: int, lengths: list[list[int]], steps: int, pause: int) -> None:
    environments = played(lengths, steps)
    returns = NStepReturns(n, GAMMA, len(lengths), 1, 1)
    pieces = fed(returns, environments, 0, min(pause, steps))
    resumed = NStepReturns(n, GAMMA, len(lengths), 1, 1)
    resumed.set_state(returns.get_state())
    pieces += fed(resumed, environments, min(pause, steps), steps)
    wanted = expected(environments, n)
    rows = concatenate(pieces) if pieces else []
    assert len(rows) == len(wanted)
    for obs, action, total, next_obs, terminated, count in zip(*rows, strict=True) if wanted else ():
        assert action[0] == obs[0] + 0.25
        assert (total, next_obs[0], terminated, count) == pytest.approx(wanted[obs[0]], rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("n", [1, 3])
def test_they_are_stable_baselines_3_s(n: int) -> None:
    buffers = pytest.importorskip("stable_baselines3.common.buffers")
    from gymnasium import spaces

    environments, box = played([[4, 2, 6]], 40), spaces.Box(-np.inf, np.inf, (1,))
    theirs = buffers.NStepReplayBuffer(100, box, box, n_steps=n, gamma=GAMMA, device="cpu")
    taken = [step for step in environments[0] if step]
    for step in taken:
        obs, following = np.array([[step["obs"]]]), np.array([[step["next_obs"]]])
        done = np.array([step["terminated"] or step["truncated"]])
        infos = [{"TimeLimit.truncated": step["truncated"]}]
        theirs.add(obs, following, obs + 0.25, np.array([step["reward"]]), done, infos)
    ours = concatenate(fed(NStepReturns(n, GAMMA, 1, 1, 1), environments, 0, 40))
    sampled = theirs._get_samples(np.arange(len(ours)), env=None)
    np.testing.assert_allclose(ours.obs, sampled.observations.numpy())
    np.testing.assert_allclose(ours.rewards, sampled.rewards.numpy()[:, 0], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(ours.next_obs, sampled.next_observations.numpy())
    np.testing.assert_allclose(ours.terminated, sampled.dones.numpy()[:, 0])
    assert sampled.discounts is not None
    np.testing.assert_allclose(GAMMA**ours.steps, sampled.discounts.numpy()[:, 0], rtol=1e-6)


def test_steps_of_another_n_are_forgotten() -> None:
    three, two = NStepReturns(3, GAMMA, 1, 1, 1), NStepReturns(2, GAMMA, 1, 1, 1)
    fed(three, played([[9]], 2), 0, 2)
    two.set_state(three.get_state())
    assert not fed(two, played([[9]], 1), 0, 1)[0].rewards.size
