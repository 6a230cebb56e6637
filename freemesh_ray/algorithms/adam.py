"""Adam without torch's bookkeeping at every step, which takes most of its time with networks this small."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch

from freemesh_ray.algorithms import compiled_adam
from freemesh_ray.algorithms.networks import on_cpu


class Moments:
    """The averages of gradients and of their squares.

    Args:
        averages, squares, steps: of each parameter, as torch keeps them.

    Attributes:
        average, square: of all parameters, one after another.
        averages, squares: their parts.
        counter: of the steps taken, one for all.
        steps: the same, as an integer.
    """

    def __init__(
        self, averages: Sequence[torch.Tensor], squares: Sequence[torch.Tensor], steps: Sequence[torch.Tensor]
    ) -> None:
        self.average, self.averages = _joined(averages)
        self.square, self.squares = _joined(squares)
        self.counter = steps[0].clone()
        self.steps = int(self.counter)

    def advance(self, steps: int) -> None:
        """Count steps that were taken elsewhere."""
        self.steps += steps
        self.counter.add_(float(steps))


def _joined(tensors: Sequence[torch.Tensor]) -> tuple[torch.Tensor, list[torch.Tensor]]:
    """The numbers of tensors one after another, and tensors that are parts of that."""
    whole = torch.cat([tensor.reshape(-1) for tensor in tensors])
    parts = whole.split([tensor.numel() for tensor in tensors])
    return whole, [part.view(tensor.shape) for part, tensor in zip(parts, tensors, strict=True)]


def flat(tensor: torch.Tensor) -> np.ndarray:
    """The numbers of a contiguous tensor on the CPU in a row, in its own memory."""
    array: np.ndarray = tensor.detach().contiguous().numpy().reshape(-1)
    return array


class LeanAdam(torch.optim.Adam):
    """torch's fused Adam for one parameter group; the same numbers but for rounding, the same state dict.

    A step is a compiled loop, or elsewhere than on a CPU torch's fused kernel; torch's hooks and records are left out.

    Raises:
        ValueError: a parameter whose numbers are not in a row: the loop would change a copy.
    """

    def __init__(
        self, parameters: Sequence[torch.Tensor], lr: float, betas: tuple[float, float] = (0.9, 0.999)
    ) -> None:
        self._moments: Moments | None = None
        parameters = list(parameters)
        if not all(parameter.is_contiguous() for parameter in parameters):
            raise ValueError("LeanAdam: a parameter is not contiguous; make it so")
        super().__init__(parameters, lr=lr, betas=betas, fused=True)

    def load_state_dict(self, state_dict: Any) -> None:
        """Take over a state."""
        super().load_state_dict(state_dict)
        self._moments = None

    @property
    def moments(self) -> Moments:
        """What the steps so far have left; it may be changed."""
        if self._moments is None:
            parameters = self.param_groups[0]["params"]
            for parameter in parameters:
                if not self.state[parameter]:
                    self.state[parameter] |= {
                        "step": torch.zeros((), device=parameter.device),
                        "exp_avg": torch.zeros_like(parameter),
                        "exp_avg_sq": torch.zeros_like(parameter),
                    }
            states = [self.state[parameter] for parameter in parameters]
            moments = Moments(*([state[key] for state in states] for key in ("exp_avg", "exp_avg_sq", "step")))
            for state, average, square in zip(states, moments.averages, moments.squares, strict=True):
                state |= {"exp_avg": average, "exp_avg_sq": square, "step": moments.counter}
            self._moments = moments
        return self._moments

    @torch.no_grad()
    def descend(self, gradients: list[torch.Tensor] | tuple[torch.Tensor, ...]) -> None:
        """Make a step along gradients, one for each parameter."""
        group, moments = self.param_groups[0], self.moments
        moments.counter.add_(1.0)
        moments.steps += 1
        if all(map(on_cpu, group["params"])):
            beta1, beta2 = group["betas"]
            for changed in zip(group["params"], gradients, moments.averages, moments.squares, strict=True):
                parameter, gradient, average, square = map(flat, changed)
                compiled_adam.descend(
                    parameter, gradient, average, square, moments.steps, group["lr"], beta1, beta2, group["eps"]
                )
            return
        torch._fused_adam_(
            group["params"],
            gradients,
            moments.averages,
            moments.squares,
            [],
            [moments.counter] * len(gradients),
            lr=group["lr"],
            beta1=group["betas"][0],
            beta2=group["betas"][1],
            weight_decay=0.0,
            eps=group["eps"],
            amsgrad=False,
            maximize=False,
        )

    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]
        """Make a step along the parameters' ``grad``."""
        self.descend([parameter.grad for parameter in self.param_groups[0]["params"]])
