"""The lean optimizer against torch's."""

from __future__ import annotations

import pytest
import torch

from freemesh_ray.algorithms.adam import LeanAdam


def descend(make: type[torch.optim.Optimizer], steps: int, reload_at: int | None = None) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    parameters = [torch.randn(shape, generator=generator) for shape in ((5, 3), (3,), (1,))]
    optimizer = make(parameters, lr=1e-2)  # type: ignore[call-arg]
    for step in range(steps):
        if step == reload_at:
            state = optimizer.state_dict()
            optimizer = make(parameters, lr=1e-2)  # type: ignore[call-arg]
            optimizer.load_state_dict(state)
        for parameter in parameters:
            parameter.grad = torch.randn(parameter.shape, generator=generator)
        optimizer.step()
    return parameters


def test_it_descends_as_torch_s_adam_does() -> None:
    for ours, theirs in zip(descend(LeanAdam, 50), descend(torch.optim.Adam, 50), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-6)


def test_a_reloaded_state_changes_nothing() -> None:
    for ours, theirs in zip(descend(LeanAdam, 20, reload_at=9), descend(LeanAdam, 20), strict=True):
        assert torch.equal(ours, theirs)


def test_the_state_is_torch_s() -> None:
    states = []
    for make in (LeanAdam, torch.optim.Adam):
        parameter = torch.nn.Parameter(torch.ones(3, 2))
        optimizer = make([parameter], lr=1e-2)
        parameter.grad = torch.arange(6.0).view(3, 2)
        optimizer.step()
        states.append(optimizer.state_dict()["state"][0])
    assert states[0].keys() == states[1].keys()
    for key in states[0]:
        torch.testing.assert_close(states[0][key], states[1][key])


def test_parameters_that_it_could_not_change_are_refused() -> None:
    with pytest.raises(ValueError, match="not contiguous"):
        LeanAdam([torch.zeros(3, 2).T], lr=1e-2)
