"""The policy's distribution against torch's own transformed distribution and against quadrature."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.distributions import Independent, Normal, TanhTransform, TransformedDistribution

from freemesh_ray.algorithms import compiled_gaussian, squashed_gaussian
from freemesh_ray.algorithms.squashed_gaussian import SquashedGaussian


def outputs(batch: int = 64, size: int = 3, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(batch, 2 * size, generator=generator, dtype=torch.float64)


def test_sample_and_density_are_the_transformed_normal_s() -> None:
    out = outputs()
    mean, log_std = squashed_gaussian.split(out)
    noise = torch.randn(mean.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    action, log_pi = squashed_gaussian.sample(out, noise)
    reference = Independent(TransformedDistribution(Normal(mean, log_std.exp()), TanhTransform()), 1)
    torch.testing.assert_close(action, torch.tanh(mean + log_std.exp() * noise))
    torch.testing.assert_close(log_pi, reference.log_prob(action), rtol=1e-5, atol=1e-5)


def test_the_density_integrates_to_one() -> None:
    distribution = SquashedGaussian(torch.tensor([[0.4, -0.7]], dtype=torch.float64))
    grid = torch.linspace(-0.999999, 0.999999, 200_001, dtype=torch.float64)
    density = distribution.logp(grid.reshape(-1, 1, 1)).exp().reshape(-1)
    np.testing.assert_allclose(torch.trapezoid(density, grid).item(), 1.0, atol=1e-4)


def test_far_tails_stay_finite() -> None:
    out = torch.tensor([[30.0, -30.0, 5.0, 5.0]])
    _, log_pi = squashed_gaussian.sample(out, torch.tensor([[9.0, -9.0]]))
    assert torch.isfinite(log_pi).all()


def test_deterministic_is_the_squashed_mean() -> None:
    """RLlib's own distribution leaves the tanh out."""
    out = outputs() * 3
    expected = torch.tanh(out[:, :3])
    torch.testing.assert_close(squashed_gaussian.deterministic(out), expected)
    torch.testing.assert_close(SquashedGaussian(out).to_deterministic().sample(), expected)


def test_log_std_is_clamped() -> None:
    _, log_std = squashed_gaussian.split(torch.tensor([[0.0, -100.0], [0.0, 100.0]]))
    assert log_std.flatten().tolist() == [-20.0, 2.0]


@pytest.mark.parametrize("scale", [1e-4, 1.0, 10.0, 40.0])
@pytest.mark.parametrize("turned", [False, True])
def test_compiled_it_is_the_same(scale: float, turned: bool) -> None:
    """Also where means are tiny or far out, deviations are clamped, and the network's output lies column by column."""
    generator = torch.Generator().manual_seed(2)
    out = scale * torch.randn(6, 256, generator=generator).T
    noise, d_action = (torch.randn(256, 3, generator=generator) for _ in range(2))
    out = out if turned else out.contiguous()
    found, expected = compiled_gaussian.sample(out, noise), squashed_gaussian.sample(out.double(), noise.double())
    for ours, theirs in zip(found, expected, strict=True):
        torch.testing.assert_close(ours.double(), theirs, rtol=1e-5, atol=1e-5)
    d_log_pi = torch.tensor([0.3])
    exact = (out.double(), noise.double(), expected[0], d_action.double(), d_log_pi.double())
    gradient = compiled_gaussian.backward(out, noise, found[0], d_action, d_log_pi)
    torch.testing.assert_close(gradient.double(), squashed_gaussian.backward(*exact), rtol=1e-4, atol=1e-4)
