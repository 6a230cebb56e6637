"""The learner on another device than the CPU: chosen, the same numbers, states that go on anywhere.

What needs a GPU is skipped where there is none; that nothing is made on the CPU by mistake is seen without one, too.
"""

from __future__ import annotations

import copy
from pathlib import Path

import pytest
import ray
import torch
from learners import ACT, BATCH, OBS, batch, learner, module, update
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID

from envs.errors import BAD_INPUT
from freemesh_ray.algorithms import device
from freemesh_ray.algorithms.ddpg import DDPGConfig
from freemesh_ray.algorithms.off_policy import OffPolicyConfig
from freemesh_ray.algorithms.off_policy_learner import Figures, Minibatch, OffPolicyLearner
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.td3 import TD3Config
from freemesh_ray.bench import gpu
from freemesh_ray.cli import command
from freemesh_ray.config import ConfigError
from freemesh_ray.studies import trainable

pytestmark = pytest.mark.slow

DEVICES = [
    "cpu",
    pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")),
]
ALGORITHMS = pytest.mark.parametrize("make_config", [SACConfig, TD3Config, DDPGConfig])


def on(kind: str, make_config: type[OffPolicyConfig], seed: int = 0) -> OffPolicyLearner:
    return learner(make_config().learners(num_gpus_per_learner=int(kind == "cuda")), seed)


@pytest.mark.parametrize(
    ("wanted", "learners", "gpus", "each"),
    [
        ("auto", 0, 0, 0), ("auto", 0, 1, 1), ("auto", 1, 1, 1), ("auto", 2, 1, 0), ("auto", 2, 2, 1),
        ("cpu", 0, 1, 0), ("cpu", 4, 8, 0), ("cuda", 0, 1, 1), ("cuda", 0, 8, 1), ("cuda", 4, 4, 1),
    ],
)  # fmt: skip
def test_a_device_is_chosen_for_every_learner_alike(wanted: str, learners: int, gpus: int, each: int) -> None:
    assert device.gpus_per_learner(wanted, learners, gpus) == each


@pytest.mark.parametrize(("learners", "gpus"), [(0, 0), (1, 0), (4, 3)])
def test_a_gpu_that_is_not_there_is_told_in_one_line(learners: int, gpus: int) -> None:
    with pytest.raises(ConfigError, match=rf"^learner.device: cuda needs {max(1, learners)} GPU.*: use auto or cpu$"):
        device.gpus_per_learner("cuda", learners, gpus)


@ALGORITHMS
def test_a_step_makes_every_tensor_on_the_learner_s_device(
    make_config: type[OffPolicyConfig], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On torch's `meta` device, where every mixture with a tensor of the CPU raises, and so does every look at one."""
    built, descended = learner(make_config()), []
    module(built).to("meta")

    def descend(module_id: str, name: str, gradients: list[torch.Tensor]) -> None:
        for parameter, gradient in zip(built.optimised(module(built), config)[name][0], gradients, strict=True):
            assert gradient.device.type == "meta"
            assert gradient.shape == parameter.shape
        descended.append(name)

    monkeypatch.setattr(built, "_descend", descend)
    columns = [torch.empty(shape, device="meta") for shape in ((OBS,), (ACT,), (), (OBS,), ())]
    rows = [column.expand(BATCH, *column.shape).clone() for column in columns]
    config = built.config
    noise = torch.empty((built.draws(config), BATCH, ACT), device="meta")
    for built._steps in (1, 2):  # the second is TD3's first with an actor
        figures = built._step(DEFAULT_POLICY_ID, config, Minibatch(*rows, noise))
    assert set(descended) == set(built.optimised(module(built), config))
    assert {figure().device.type for figure in figures.values()} == {"meta"}


@ALGORITHMS
def test_the_batch_and_its_noise_come_to_the_learner_s_device(
    make_config: type[OffPolicyConfig], monkeypatch: pytest.MonkeyPatch
) -> None:
    built = learner(make_config())
    built._device = torch.device("meta")
    seen: list[torch.Tensor] = []

    def step(module_id: str, config: OffPolicyConfig, minibatch: Minibatch) -> Figures:
        seen.extend(minibatch)
        return {"critic_loss": lambda: torch.zeros(1)}

    monkeypatch.setattr(built, "_step", step)
    update(built, batch(3))
    assert len(seen) == 3 * 6
    assert {tensor.device.type for tensor in seen} == {"meta"}
    assert [tuple(tensor.shape) for tensor in seen[:6]] == [
        (BATCH, OBS), (BATCH, ACT), (BATCH,), (BATCH, OBS), (BATCH,), (built.draws(built.config), BATCH, ACT)
    ]  # fmt: skip


@ALGORITHMS
@pytest.mark.parametrize("kind", DEVICES)
def test_every_device_takes_the_same_steps(kind: str, make_config: type[OffPolicyConfig]) -> None:
    built, expected = on(kind, make_config), on("cpu", make_config)
    figures, wanted = update(built, batch(4)), update(expected, batch(4))
    assert {parameter.device.type for parameter in module(built).parameters()} == {kind}
    for name, tensor in module(expected).state_dict().items():
        torch.testing.assert_close(module(built).state_dict()[name].cpu(), tensor, rtol=1e-3, atol=1e-5)
    for name in ("critic_loss", "actor_loss", "q_mean"):
        assert float(figures[name]) == pytest.approx(float(wanted[name]), rel=1e-3, abs=1e-5)


@ALGORITHMS
@pytest.mark.parametrize("after", DEVICES)
@pytest.mark.parametrize("before", DEVICES)
def test_a_state_goes_on_on_any_device(before: str, after: str, make_config: type[OffPolicyConfig]) -> None:
    built, again = on(before, make_config), on(after, make_config, seed=9)
    update(built, batch(3))
    state = built.get_state()
    assert not any(torch.is_tensor(value) for value in state["rl_module"][DEFAULT_POLICY_ID].values())
    again.set_state(copy.deepcopy(state))
    for one in (built, again):
        update(one, batch(3, seed=2))
    for name, tensor in module(built).state_dict().items():
        torch.testing.assert_close(
            module(again).state_dict()[name].cpu(), tensor.cpu(), rtol=0 if before == after else 1e-3, atol=1e-6
        )


def test_a_cluster_s_gpus_count_only_for_a_torch_that_can_use_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray, "cluster_resources", lambda: {"CPU": 8.0, "GPU": 2.0})
    for built, gpus in ((True, 2), (False, 0)):
        monkeypatch.setattr(torch.backends.cuda, "is_built", lambda built=built: built)
        assert device.gpus_here(2) == gpus


@pytest.mark.parametrize(
    ("runners", "learners", "wanted", "gpus", "bundles"),
    [
        (2, 0, "auto", 0, [(1, 0)] * 3),
        (2, 0, "auto", 1, [(1, 1), (1, 0), (1, 0)]),
        (1, 2, "cpu", 4, [(1, 0)] * 4),
        (1, 2, "cuda", 4, [(1, 0), (1, 1), (1, 1), (1, 0)]),
    ],
)
def test_a_trial_of_a_study_takes_what_its_processes_need(
    runners: int, learners: int, wanted: str, gpus: int, bundles: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainable, "cluster_gpus", lambda: gpus)
    config = {"learner": {"count": learners, "device": wanted}, "runners": {"count": runners}}
    taken = trainable.resources(config).bundles
    assert [(bundle["CPU"], bundle.get("GPU", 0)) for bundle in taken] == bundles


def test_a_training_that_wants_a_missing_gpu_begins_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    monkeypatch.chdir(tmp_path)
    assert command.main(["train", "--set", "learner.device=cuda"]) == BAD_INPUT
    assert capsys.readouterr().err == "freemesh: learner.device: cuda needs 1 GPU(s), there are 0: use auto or cpu\n"
    assert not list(tmp_path.iterdir())


def test_speeds_are_measured_on_the_devices_that_there_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(gpu, "BATCHES", (8, 32))
    monkeypatch.setattr(gpu, "CALLS", (1, 4))
    monkeypatch.setattr(gpu, "MOST_ROWS", 64)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    gpu.run(0.0)
    title, header, *rows, last = capsys.readouterr().out.splitlines()
    assert "updates a second" in title
    assert header.split()[-1] == "cpu"
    assert [row.split()[:2] for row in rows] == [["8", "1"], ["8", "4"], ["32", "1"]]
    assert all(float(row.split()[2].replace(",", "")) > 0 for row in rows)
    assert last == "no CUDA device here: nothing was measured on one"
