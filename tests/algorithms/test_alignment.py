"""Wherever NumPy's arrays lie in memory, learners and env runners come to the same numbers, to the last bit."""

from __future__ import annotations

import copy
from collections.abc import Iterator

import numpy as np
import pytest
import torch
from learners import batch, learner, module, update

from freemesh_ray import config
from freemesh_ray.algorithms.alignment import BYTES, aligned
from freemesh_ray.algorithms.build import build
from freemesh_ray.algorithms.ddpg import DDPGConfig
from freemesh_ray.algorithms.env_runner import Collected, TransitionEnvRunner
from freemesh_ray.algorithms.off_policy import OffPolicyConfig
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.td3 import TD3Config
from freemesh_ray.local_ray import local_ray

FLOAT = 4
ADDRESSES = range(0, BYTES, FLOAT)
#: A layer of one unit: what feeds it is summed in an order that depends on its address, on some processors at least.
NARROW = [1, 16]


def placed(array: np.ndarray, address: int) -> np.ndarray:
    """A copy that begins ``address`` bytes after a multiple of BYTES."""
    room = np.empty(array.size + 2 * BYTES // FLOAT, np.float32)
    first = (address - room.ctypes.data) % BYTES // FLOAT
    copied = room[first : first + array.size].reshape(array.shape)
    copied[...] = array
    assert copied.ctypes.data % BYTES == address
    return copied


@pytest.mark.parametrize("address", ADDRESSES)
def test_what_is_aligned_is_the_same_and_copied_only_where_it_must_be(address: int) -> None:
    given = torch.from_numpy(placed(np.arange(21, dtype=np.float32).reshape(7, 3), address))
    found = aligned(given)
    assert found.data_ptr() % BYTES == 0
    assert torch.equal(found, given)
    assert (found is given) == (address == 0)


@pytest.mark.slow
@pytest.mark.parametrize("make_config", [SACConfig, TD3Config, DDPGConfig])
def test_a_learner_learns_the_same_from_minibatches_anywhere(make_config: type[OffPolicyConfig]) -> None:
    rows = batch(3)
    expected = None
    for address in ADDRESSES:
        one = learner(make_config(), hidden=NARROW)
        update(one, {key: placed(column, address) for key, column in rows.items()})
        found = module(one).state_dict()
        expected = expected or found
        for name, tensor in found.items():
            assert torch.equal(tensor, expected[name]), (name, address)


@pytest.mark.slow
@pytest.mark.parametrize("make_config", [SACConfig, TD3Config, DDPGConfig])
def test_a_learner_goes_on_the_same_from_a_state_anywhere(make_config: type[OffPolicyConfig]) -> None:
    begun = learner(make_config(), hidden=NARROW)
    update(begun, batch(3))
    state = begun.get_state()
    update(begun, batch(3, seed=2))
    for address in ADDRESSES:
        one = learner(make_config(), seed=9, hidden=NARROW)
        one.set_state(moved(state, address))
        update(one, batch(3, seed=2))
        for name, tensor in module(one).state_dict().items():
            assert torch.equal(tensor, module(begun).state_dict()[name]), (name, address)


def moved(node: object, address: int) -> object:
    """A tree with its arrays of float32 at an address."""
    if isinstance(node, dict):
        return {key: moved(value, address) for key, value in node.items()}
    if isinstance(node, list | tuple):
        return type(node)([moved(value, address) for value in node])
    if isinstance(node, np.ndarray) and node.dtype == np.float32:
        return placed(node, address)
    return copy.deepcopy(node)


@pytest.fixture(scope="module")
def runner() -> Iterator[TransitionEnvRunner]:
    with local_ray(1):
        algorithm = build(config.load(["train_smoke"], ["runners.count=0", f"learner.hidden={NARROW}"]))
        with torch.no_grad():
            algorithm.env_runner.module.actor.biases[0].fill_(0.5)  # the unit is not cut off
        yield algorithm.env_runner
        algorithm.stop()


def test_a_runner_goes_on_the_same_from_a_state_anywhere(runner: TransitionEnvRunner) -> None:
    """A message from another process is unpacked wherever it lies."""
    runner.collect(3)
    state = runner.rollout_state()
    expected = None
    for address in ADDRESSES:
        runner.set_rollout_state({**copy.deepcopy(state), "obs": placed(state["obs"], address)})
        collected = runner.collect(1)
        assert isinstance(collected, Collected)
        expected = collected.transitions.actions if expected is None else expected
        np.testing.assert_array_equal(collected.transitions.actions, expected, err_msg=str(address))
