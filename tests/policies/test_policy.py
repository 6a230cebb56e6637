"""The exported policy: one file, no Ray, the same actions."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from envs.mdp.observation import observation_size
from envs.types import MeshingParameters
from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.algorithms.networks import Mlp
from freemesh_ray.policies.policy import Policy, PolicyError


def policy(seed: int = 0, **parameters: object) -> Policy:
    random = np.random.default_rng(seed)
    made = MeshingParameters(**parameters)
    sizes = [observation_size(made), 16, 16, 2 * made.action_size]
    layers = [
        (random.standard_normal((a, b)).astype(np.float32) / 4, random.standard_normal(b).astype(np.float32))
        for a, b in zip(sizes[:-1], sizes[1:], strict=True)
    ]
    return Policy(layers, made, {"seed": seed})


def test_it_acts_as_the_network_that_was_trained() -> None:
    made, obs = policy(), np.random.default_rng(1).standard_normal((50, 15)).astype(np.float32)
    net = Mlp(15, [16, 16], 6)
    net.load_state_dict(
        {f"weights.{i}": torch.from_numpy(w) for i, (w, _) in enumerate(made.layers)}
        | {f"biases.{i}": torch.from_numpy(b) for i, (_, b) in enumerate(made.layers)}
    )
    expected = squashed_gaussian.deterministic(net(torch.from_numpy(obs))).detach().numpy()
    np.testing.assert_allclose(made.act(obs, False, np.random.default_rng(0)), expected, rtol=1e-4, atol=1e-5)


def test_sampling_follows_the_distribution_row_by_row() -> None:
    made, obs = policy(), np.zeros((20_000, 15), dtype=np.float32)
    sample = np.arange(20_000) % 2 == 0
    actions = made.act(obs, sample, np.random.default_rng(0))
    mean = made.act(obs[:1], False, np.random.default_rng(0))
    np.testing.assert_allclose(actions[~sample], np.broadcast_to(mean, (10_000, 3)), atol=1e-5)
    # tanh is monotone: the median of the drawn actions is the deterministic one.
    np.testing.assert_allclose(np.median(actions[sample], axis=0), mean[0], atol=0.05)
    assert actions[sample].std(axis=0).min() > 1e-3


def test_a_round_trip_keeps_every_bit(tmp_path: Path) -> None:
    made = policy(n=3, g=4, density="printed")
    made.save(tmp_path / "sub" / "policy.npz")
    again = Policy.load(tmp_path / "sub" / "policy.npz")
    assert again.parameters == made.parameters
    assert again.about == made.about
    for ours, theirs in zip(again.layers, made.layers, strict=True):
        np.testing.assert_array_equal(ours[0], theirs[0])
        np.testing.assert_array_equal(ours[1], theirs[1])
    assert list((tmp_path / "sub").iterdir()) == [tmp_path / "sub" / "policy.npz"]


def test_a_policy_says_its_scale_and_an_old_one_has_the_front_s(tmp_path: Path) -> None:
    made = policy(scale="size", size_gradient=0.1)
    made.save(tmp_path / "sizes.npz")
    assert Policy.load(tmp_path / "sizes.npz").parameters == made.parameters
    policy().save(tmp_path / "now.npz")
    with np.load(tmp_path / "now.npz") as archive:
        arrays = dict(archive)
    about = json.loads(str(arrays["about"]))
    for name in ("scale", "size_gradient"):
        del about["parameters"][name]
    np.savez(tmp_path / "old.npz", **arrays | {"about": np.array(json.dumps(about))})
    assert Policy.load(tmp_path / "old.npz").parameters == MeshingParameters(scale="front")


def test_critics_are_kept_with_the_policy(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    critic = [
        (random.standard_normal((2, a, b)).astype(np.float32), random.standard_normal((2, b)).astype(np.float32))
        for a, b in ((18, 16), (16, 1))
    ]
    made = policy()
    Policy(made.layers, made.parameters, made.about, critic).save(tmp_path / "policy.npz")
    again = Policy.load(tmp_path / "policy.npz")
    assert len(again.layers) == len(made.layers)
    for ours, theirs in zip(again.critic, critic, strict=True):
        np.testing.assert_array_equal(ours[0], theirs[0])
        np.testing.assert_array_equal(ours[1], theirs[1])
    made.save(tmp_path / "old.npz")
    assert list(Policy.load(tmp_path / "old.npz").critic) == []


def test_critics_that_do_not_fit_are_refused() -> None:
    made = policy()
    weight, bias = np.zeros((2, 18, 1), dtype=np.float32), np.zeros((2, 1), dtype=np.float32)
    for wrong in ([(weight[:, :17], bias)], [(weight, bias[:1])], [(weight, bias), (weight[:1], bias[:1])]):
        with pytest.raises(PolicyError, match="critic"):
            Policy(made.layers, made.parameters, made.about, wrong)
    with pytest.raises(PolicyError, match="not finite"):
        Policy(made.layers, made.parameters, made.about, [(weight * np.nan, bias)])


def test_loading_and_meshing_need_neither_ray_nor_torch_nor_mlflow(tmp_path: Path) -> None:
    policy().save(tmp_path / "policy.npz")
    code = (
        "import sys; from freemesh_ray.policies.policy import Policy; from freemesh_ray.mesher import mesh_domain;"
        f"Policy.load({str(tmp_path / 'policy.npz')!r});"
        "heavy = {'ray', 'torch', 'mlflow'} & set(sys.modules); assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(PolicyError, match=r"nowhere\.npz: no such policy file"):
        Policy.load("nowhere.npz")


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04 broken"])
def test_a_wrong_file_is_named(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "policy.npz"
    path.write_bytes(content)
    with pytest.raises(PolicyError, match="not a policy file"):
        Policy.load(path)


def test_damaged_weights_are_refused() -> None:
    layers = list(policy().layers)
    with pytest.raises(PolicyError, match="not finite"):
        Policy([(layers[0][0] * np.nan, layers[0][1]), *layers[1:]], MeshingParameters())
    with pytest.raises(PolicyError, match="fit"):
        Policy([layers[0], layers[0], layers[2]], MeshingParameters())
    with pytest.raises(PolicyError, match="fit"):
        Policy([(layers[0][0], layers[0][1][:3]), *layers[1:]], MeshingParameters())


def test_a_network_of_other_widths_is_refused() -> None:
    with pytest.raises(PolicyError, match="15 -> 6"):
        Policy(policy().layers, MeshingParameters(n=3))
