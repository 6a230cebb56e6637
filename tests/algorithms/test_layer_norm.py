"""Critics with layer normalisation against networks made of torch's own modules."""

from __future__ import annotations

import pytest
import torch
from learners import batch, learner, module, update
from torch import nn

from freemesh_ray import config
from freemesh_ray.algorithms.crossq import CrossQConfig
from freemesh_ray.algorithms.layer_norm import EPSILON, LayerNormMlpStack
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.td3 import TD3Config
from freemesh_ray.config import ConfigError


def test_each_is_what_torch_s_modules_make_of_its_weights() -> None:
    torch.manual_seed(0)
    stack = LayerNormMlpStack(2, 7, [16, 8], 1)
    with torch.no_grad():
        for parameter in stack.parameters():
            parameter.copy_(torch.randn_like(parameter))
    x = torch.randn(50, 7)
    for k, outputs in enumerate(stack(x)):
        layers: list[nn.Module] = []
        for weight, bias, norm in zip(stack.weights, stack.biases, [*stack.layer_norms, None], strict=True):
            linear = nn.Linear(*weight.shape[1:])
            linear.load_state_dict({"weight": weight[k].T, "bias": bias[k, 0]})
            layers.append(linear)
            if norm is not None:
                theirs = nn.LayerNorm(weight.shape[-1], eps=EPSILON)
                theirs.load_state_dict({"weight": norm.gain[k, 0], "bias": norm.shift[k, 0]})
                layers += [theirs, nn.ReLU()]
        torch.testing.assert_close(outputs, nn.Sequential(*layers)(x), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
@pytest.mark.parametrize("make_config", [SACConfig, TD3Config])
def test_a_learner_takes_the_textbook_s_step(
    make_config: type[SACConfig] | type[TD3Config], precision: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The written-out one knows nothing of the normalisation."""
    built = learner(make_config().training(layer_norm=True, precision=precision))
    monkeypatch.setattr(type(built), "_step", None)
    assert isinstance(module(built).critic, LayerNormMlpStack)
    assert isinstance(module(built).target_critic, LayerNormMlpStack)
    before = {name: tensor.clone() for name, tensor in module(built).state_dict().items()}
    update(built, batch(4))
    for name, tensor in module(built).state_dict().items():
        assert not torch.equal(tensor, before[name]), name


def test_crossq_has_a_normalisation_of_its_own() -> None:
    with pytest.raises(ConfigError, match=r"^learner.layer_norm = true: .*: set false$"):
        CrossQConfig().configure(config.load([], ["algorithm=crossq", "learner.layer_norm=true"]))
