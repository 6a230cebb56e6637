"""The networks against torch's own layers."""

from __future__ import annotations

import torch
from torch import nn

from freemesh_ray.algorithms.networks import Mlp, MlpStack


def reference(mlp_weights: list[torch.Tensor], mlp_biases: list[torch.Tensor]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for weight, bias in zip(mlp_weights, mlp_biases, strict=True):
        linear = nn.Linear(*weight.shape)
        with torch.no_grad():
            linear.weight.copy_(weight.T)
            linear.bias.copy_(bias.flatten())
        layers += [linear, nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def test_mlp_is_linear_relu_linear() -> None:
    net, x = Mlp(15, [32, 16], 6), torch.randn(10, 15)
    torch.testing.assert_close(net(x), reference(list(net.weights), list(net.biases))(x))


def test_a_stack_is_separate_mlps() -> None:
    stack, x = MlpStack(2, 18, [32, 16], 1), torch.randn(10, 18)
    for i in range(2):
        one = reference([w[i] for w in stack.weights], [b[i] for b in stack.biases])
        torch.testing.assert_close(stack(x)[i], one(x))


def test_a_stack_s_gradients_do_not_mix() -> None:
    stack = MlpStack(2, 4, [8], 1)
    stack(torch.randn(5, 4))[0].sum().backward()
    assert all(parameter.grad is not None and not parameter.grad[1].any() for parameter in stack.parameters())
    assert all(parameter.grad is not None and parameter.grad[0].any() for parameter in stack.parameters())


def test_initial_weights_are_nn_linear_s() -> None:
    weights = torch.cat([Mlp(64, [64], 64).weights[0].detach().flatten() for _ in range(20)])
    assert weights.abs().max() <= 1 / 8
    assert abs(weights.var().item() - (1 / 8) ** 2 / 3) < 1e-4


def test_the_paper_s_network_has_the_paper_s_size() -> None:
    """15 observations, three hidden layers of 128, mean and deviation of 3 actions."""
    expected = 15 * 128 + 128 + 2 * (128 * 128 + 128) + 128 * 6 + 6
    assert sum(p.numel() for p in Mlp(15, [128, 128, 128], 6).parameters()) == expected
