"""Products of bfloat16 numbers against those of float32 ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from learners import batch, learner, module, update
from torch.nn.functional import cosine_similarity

from freemesh_ray import config
from freemesh_ray.algorithms import bfloat16
from freemesh_ray.algorithms.bfloat16 import Bfloat16Mlp
from freemesh_ray.algorithms.build import build
from freemesh_ray.algorithms.ddpg import DDPGConfig
from freemesh_ray.algorithms.networks import Mlp, MlpStack
from freemesh_ray.algorithms.off_policy import OffPolicyConfig
from freemesh_ray.algorithms.off_policy_learner import OffPolicyLearner
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.td3 import TD3Config
from freemesh_ray.local_ray import local_ray

#: Of outputs: some times 2^-8, what a number of 8 bits is rounded by. Of gradients: one of a thousand hidden outputs
#: is so near 0 that rounding switches it on or off, which changes a gradient by the root of that share.
OUTPUT, GRADIENT = 0.01, 0.12
NETWORKS: dict[str, Callable[[], Mlp]] = {
    "one": lambda: Mlp(15, [128, 128, 128], 6),
    "stack": lambda: MlpStack(2, 18, [128, 128, 128], 1),
    "shallow": lambda: MlpStack(3, 7, [16], 2),
}
LEARNERS = [SACConfig, TD3Config, DDPGConfig]


def difference(ours: torch.Tensor, theirs: torch.Tensor) -> float:
    """Of two arrays, relative to their length."""
    return float(((ours - theirs).norm() / theirs.norm()).detach())


@pytest.mark.parametrize("name", NETWORKS)
def test_outputs_and_gradients_differ_by_rounding_alone(name: str) -> None:
    torch.manual_seed(0)
    network = NETWORKS[name]()
    rounded = Bfloat16Mlp(network)
    x = torch.randn(256, network.weights[0].shape[-2])
    trace, expected = rounded.trace(x), network.trace(x)
    assert trace[-1].dtype == torch.float32
    assert not torch.equal(trace[-1], expected[-1])
    assert difference(trace[-1], expected[-1]) < OUTPUT
    assert torch.equal(trace[-1], rounded(x))
    gradient = torch.randn_like(expected[-1])
    for ours, theirs, parameter in zip(
        rounded.backward(trace, gradient), network.backward(expected, gradient), network.parameters(), strict=True
    ):
        assert ours.dtype == torch.float32
        assert ours.shape == parameter.shape
        assert difference(ours, theirs) < GRADIENT
    ours, theirs = rounded.backward_to_input(trace, gradient), network.backward_to_input(expected, gradient)
    assert ours.dtype == torch.float32
    assert difference(ours, theirs) < GRADIENT


def test_weights_are_read_when_it_is_told() -> None:
    network, x = Mlp(5, [8], 2), torch.randn(4, 5)
    rounded = Bfloat16Mlp(network)
    before = rounded(x)
    with torch.no_grad():
        network.weights[0].mul_(3.0)
    assert torch.equal(rounded(x), before)
    rounded.refresh()
    assert difference(rounded(x), network(x)) < OUTPUT


def learnt(config: OffPolicyConfig, *, by_autograd: bool = False) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """What a learner's module is after some steps, by name, and the figures."""
    built = learner(config.training(tau=0.3), hidden=(64, 64))
    if by_autograd:
        built._step = OffPolicyLearner._step.__get__(built)  # type: ignore[method-assign]
    start = {name: tensor.clone() for name, tensor in module(built).state_dict().items()}
    figures = update(built, batch(6))
    return {name: tensor - start[name] for name, tensor in module(built).state_dict().items()}, figures


@pytest.mark.slow
@pytest.mark.parametrize("make_config", LEARNERS)
@pytest.mark.parametrize("by_autograd", [False, True])
def test_a_learner_goes_the_same_way_with_either(make_config: type[OffPolicyConfig], by_autograd: bool) -> None:
    ways, figures = learnt(make_config().training(precision="bfloat16"), by_autograd=by_autograd)
    expected, told = learnt(make_config().training(precision="float32"))
    assert any(not torch.equal(way, expected[name]) for name, way in ways.items())
    for name, way in ways.items():
        assert way.dtype == torch.float32
        assert cosine_similarity(way.flatten(), expected[name].flatten(), dim=0) > 0.95, name
    for name in ("critic_loss", "actor_loss"):
        assert float(figures[name]) == pytest.approx(float(told[name]), rel=0.05, abs=0.05)


@pytest.mark.slow
def test_set_weights_are_those_that_it_goes_on_with() -> None:
    config = SACConfig().training(precision="bfloat16")
    one, other = learner(config), learner(config.copy(copy_frozen=False), seed=5)
    update(one, batch(3))
    other.set_state(one.get_state())
    for built in (one, other):
        update(built, batch(2, seed=9))
    for ours, theirs in zip(module(one).parameters(), module(other).parameters(), strict=True):
        assert torch.equal(ours, theirs)


@pytest.mark.parametrize(
    ("precision", "device", "there", "rounds"),
    [
        ("float32", "cpu", True, False), ("bfloat16", "cpu", False, True), ("bfloat16", "cuda", False, True),
        ("auto", "cpu", True, True), ("auto", "cpu", False, False), ("auto", "cuda", True, False),
    ],
)  # fmt: skip
def test_auto_rounds_where_the_processor_can(
    precision: str, device: str, there: bool, rounds: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bfloat16, "native", lambda: there)
    assert bfloat16.wanted(precision, torch.device(device)) is rounds


@pytest.mark.slow
@pytest.mark.parametrize("there", [True, False])
def test_a_learner_takes_auto(there: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bfloat16, "native", lambda: there)
    auto, fixed = (
        learnt(SACConfig().training(precision=precision))[0]
        for precision in ("auto", "bfloat16" if there else "float32")
    )
    for name, way in auto.items():
        assert torch.equal(way, fixed[name]), name


@pytest.mark.slow
@pytest.mark.parametrize("there", [True, False])
def test_a_processor_that_cannot_is_told(there: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one line; the training goes on."""
    monkeypatch.setattr(bfloat16, "native", lambda: there)
    with local_ray(0):
        algorithm = build(config.load(["train_smoke"], ["runners.count=0", "learner.precision=bfloat16"]))
        assert len(algorithm.incidents) == (not there)
        assert all(line.startswith("learner.precision: ") and "\n" not in line for line in algorithm.incidents)
        algorithm.stop()
