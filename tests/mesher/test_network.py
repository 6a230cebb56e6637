"""The compiled forward pass against NumPy's, for networks of any depth and width."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.mdp.observation import observation_size
from envs.types import MeshingParameters
from freemesh_ray.mesher.agent import agent, mean_action, sampled_action, value
from freemesh_ray.mesher.forward_pass import LANES, forward, pack, padded
from freemesh_ray.policies.policy import Policy

Layers = list[tuple[np.ndarray, np.ndarray]]


def layers(sizes: list[int], seed: int, lead: tuple[int, ...] = ()) -> Layers:
    random = np.random.default_rng(seed)
    return [
        (
            (random.standard_normal((*lead, a, b)) / np.sqrt(a)).astype(np.float32),
            random.standard_normal((*lead, b)).astype(np.float32),
        )
        for a, b in zip(sizes[:-1], sizes[1:], strict=True)
    ]


def reference(network: Layers, x: np.ndarray) -> np.ndarray:
    """The same in float64."""
    x = x.astype(np.float64)
    for weight, bias in network[:-1]:
        x = np.maximum(x @ weight + bias, 0.0)
    return x @ network[-1][0] + network[-1][1]


@pytest.mark.slow
@given(st.lists(st.integers(1, 70), min_size=2, max_size=5), st.integers(0, 2**32 - 1))
def test_outputs_are_those_of_the_layers(sizes: list[int], seed: int) -> None:
    made = layers(sizes, seed)
    network = pack(made)
    random, outputs = np.random.default_rng(seed), np.empty(sizes[-1], dtype=np.float32)
    for _ in range(3):
        x = random.standard_normal(sizes[0]).astype(np.float32) * (random.random(sizes[0]) < 0.8)
        forward(network, x, outputs)
        np.testing.assert_allclose(outputs, reference(made, x), rtol=1e-4, atol=1e-5)


def test_the_same_input_gives_the_same_bits() -> None:
    network, x = pack(layers([15, 128, 128, 6], 0)), np.linspace(-1, 1, 15, dtype=np.float32)
    first, second = (np.empty(6, dtype=np.float32) for _ in range(2))
    forward(network, x, first)
    forward(network, np.zeros(15, dtype=np.float32), second)
    forward(network, x, second)
    np.testing.assert_array_equal(first, second)


@given(st.integers(1, 10_000))
def test_padding_is_the_least(width: int) -> None:
    assert padded(width) % LANES == 0
    assert width <= padded(width) < width + LANES


@pytest.mark.parametrize("parameters", [MeshingParameters(), MeshingParameters(n=3, g=4, type2=True)])
def test_actions_are_the_policy_s(parameters: MeshingParameters) -> None:
    size, acted = observation_size(parameters), parameters.action_size
    policy = Policy(layers([size, 40, 40, 2 * acted], 1), parameters)
    compiled, action = agent(policy), np.empty(5)
    for obs in np.random.default_rng(2).uniform(-1, 2, (20, size)).astype(np.float32):
        forward(compiled.actor, obs, compiled.outputs)
        mean_action(compiled, action)
        expected = policy.act(obs[None], False, np.random.default_rng(0))[0]
        np.testing.assert_allclose(action[:acted], expected, atol=1e-5)


@pytest.mark.slow
def test_draws_follow_the_policy_s_distribution() -> None:
    policy = Policy(layers([15, 6], 3), MeshingParameters())
    compiled, action, random = agent(policy), np.empty(5), np.random.default_rng(4)
    obs = np.full(15, 0.3, dtype=np.float32)
    forward(compiled.actor, obs, compiled.outputs)
    drawn = np.empty((20_000, 3))
    for row in drawn:
        sampled_action(compiled, random, action)
        row[:] = action[:3]
    expected = policy.act(np.repeat(obs[None], 20_000, axis=0), True, np.random.default_rng(5))
    for q in (0.1, 0.5, 0.9):
        np.testing.assert_allclose(np.quantile(drawn, q, axis=0), np.quantile(expected, q, axis=0), atol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("twins", [1, 2])
def test_the_value_is_the_lesser_of_the_critics(twins: int) -> None:
    critic = layers([18, 24, 1], 6, (twins,))
    compiled = agent(Policy(layers([15, 6], 7), MeshingParameters(), critic=critic))
    random = np.random.default_rng(8)
    for _ in range(20):
        compiled.observation[:] = random.standard_normal(15)
        action = random.uniform(-1, 1, 5)
        question = np.concatenate([compiled.observation, action[:3].astype(np.float32)])
        expected = min(reference([(w[i], b[i]) for w, b in critic], question)[0] for i in range(twins))
        assert value(compiled, action) == pytest.approx(expected, abs=1e-5)
