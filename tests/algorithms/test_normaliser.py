"""The running figures against those of all rows together, and networks with the normaliser folded in."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from learners import ACT, OBS, batch, learner, module, update
from ray.rllib.core.columns import Columns

from freemesh_ray.algorithms.networks import Mlp, MlpStack
from freemesh_ray.algorithms.normaliser import Normaliser, folded
from freemesh_ray.algorithms.sac import SACConfig


def numbers(rows: int, seed: int) -> torch.Tensor:
    """(rows, OBS) of very unlike means and deviations."""
    random = np.random.default_rng(seed)
    return torch.from_numpy(random.normal(np.arange(OBS) * 3.0, 0.01 + np.arange(OBS), (rows, OBS)).astype(np.float32))


@given(st.lists(st.integers(1, 50), min_size=1, max_size=6), st.integers(0, 100))
def test_figures_are_those_of_all_rows_together(sizes: list[int], seed: int) -> None:
    rows, normaliser = numbers(sum(sizes), seed), Normaliser(OBS)
    for piece in rows.split(sizes):
        normaliser.take(piece)
    torch.testing.assert_close(normaliser.mean, rows.mean(dim=0), rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(normaliser.variance, rows.var(dim=0, unbiased=False), rtol=1e-2, atol=1e-2)


def test_what_was_seen_has_mean_0_and_variance_1() -> None:
    rows, normaliser = numbers(5000, 0), Normaliser(OBS)
    torch.testing.assert_close(normaliser(rows), rows, rtol=1e-5, atol=1e-5)  # until it has seen any
    normaliser.take(rows)
    seen = normaliser(rows)
    torch.testing.assert_close(seen.mean(dim=0), torch.zeros(OBS), rtol=0, atol=1e-2)
    torch.testing.assert_close(seen.var(dim=0), torch.ones(OBS), rtol=0, atol=2e-2)


def test_folded_layers_do_the_same_to_plain_observations() -> None:
    rows, normaliser = numbers(200, 1), Normaliser(OBS)
    normaliser.take(rows)
    figures = normaliser.mean.numpy(), normaliser.variance.numpy()
    actor, critic = Mlp(OBS, [16], 4), MlpStack(2, OBS + ACT, [16], 1)
    actions = torch.rand(200, ACT)
    for network, plain, seen in (
        (actor, rows, normaliser(rows)),
        (critic, torch.cat([rows, actions], dim=1), torch.cat([normaliser(rows), actions], dim=1)),
    ):
        layers = [(w.detach().numpy(), b.detach().numpy().reshape(*w.shape[:-2], -1)) for w, b in zip(
            network.weights, network.biases, strict=True
        )]  # fmt: skip
        values = plain.numpy()
        for i, (weight, bias) in enumerate(folded(layers, *figures)):
            values = values @ weight + bias[..., None, :]
            values = np.maximum(values, 0.0) if i == 0 else values
        np.testing.assert_allclose(values, network(seen).detach().numpy(), rtol=1e-3, atol=1e-3)


@pytest.mark.slow
def test_a_learner_s_networks_see_normalised_observations() -> None:
    """Shifted and scaled observations teach the same as the plain ones."""
    shifted = batch(20)
    scale, shift = np.linspace(0.5, 50.0, OBS, dtype=np.float32), np.linspace(-30.0, 9.0, OBS, dtype=np.float32)
    for key in (Columns.OBS, Columns.NEXT_OBS):
        shifted[key] = shifted[key] * scale + shift
    ways = []
    for rows in (batch(20), shifted):
        built = learner(SACConfig().training(normalise_observations=True))
        update(built, rows)
        ways.append(module(built))
    for ours, theirs in zip(ways[0].actor.parameters(), ways[1].actor.parameters(), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-2, atol=1e-3)
    assert not torch.equal(ways[0].normaliser.mean, ways[1].normaliser.mean)


@pytest.mark.slow
def test_it_is_in_the_state() -> None:
    built, again = (learner(SACConfig().training(normalise_observations=True)) for _ in range(2))
    update(built, batch(3))
    again.set_state(built.get_state())
    assert torch.equal(module(again).normaliser.mean, module(built).normaliser.mean)
    assert module(again).normaliser.count.item() == module(built).normaliser.count.item() == 3 * 32
