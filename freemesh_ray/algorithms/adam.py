"""Adam without torch's bookkeeping at every step, which takes most of its time with networks this small."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch

from freemesh_ray.algorithms import compiled_adam
from freemesh_ray.algorithms.networks import on_cpu


class LeanAdam(torch.optim.Adam):
    """torch's fused Adam for one parameter group; the same numbers but for rounding, the same state dict.

    A step is a compiled loop, or elsewhere than on a CPU torch's fused kernel; torch's hooks and records are left out.
    """

    def __init__(
        self, parameters: Sequence[torch.Tensor], lr: float, betas: tuple[float, float] = (0.9, 0.999)
    ) -> None:
        self._tensors: tuple[list[torch.Tensor], ...] | None = None
        #: Parameters and averages as the compiled loop reads them; empty where it cannot.
        self._flat: list[tuple[np.ndarray, ...]] = []
        self._taken = 0
        super().__init__(list(parameters), lr=lr, betas=betas, fused=True)

    def load_state_dict(self, state_dict: Any) -> None:
        """Take over a state."""
        super().load_state_dict(state_dict)
        self._tensors = None

    def _remembered(self) -> tuple[list[torch.Tensor], ...]:
        """The averages of gradients and of squares, and the counter of steps, by parameter."""
        parameters = self.param_groups[0]["params"]
        for parameter in parameters:
            if not self.state[parameter]:
                self.state[parameter] |= {
                    "step": torch.zeros((), device=parameter.device),
                    "exp_avg": torch.zeros_like(parameter),
                    "exp_avg_sq": torch.zeros_like(parameter),
                }
        states = [self.state[parameter] for parameter in parameters]
        counter = states[0]["step"].clone()
        for state in states:
            state["step"] = counter  # one counter for all
        averages, squares = ([state[key] for state in states] for key in ("exp_avg", "exp_avg_sq"))
        self._taken = int(counter)
        here = all(on_cpu(tensor) and tensor.is_contiguous() for tensor in (*parameters, *averages, *squares))
        rows = zip(parameters, averages, squares, strict=True)
        self._flat = [tuple(map(_flat, row)) for row in rows] if here else []
        return averages, squares, [counter] * len(states)

    @torch.no_grad()
    def descend(self, gradients: list[torch.Tensor] | tuple[torch.Tensor, ...]) -> None:
        """Make a step along gradients, one for each parameter."""
        group = self.param_groups[0]
        if self._tensors is None:
            self._tensors = self._remembered()
        averages, squares, steps = self._tensors
        steps[0].add_(1.0)
        self._taken += 1
        if self._flat:
            beta1, beta2 = group["betas"]
            rate = np.float32(group["lr"] / (1.0 - beta1**self._taken))
            root = np.float32(math.sqrt(1.0 - beta2**self._taken))
            constants = rate, np.float32(beta1), np.float32(beta2), root, np.float32(group["eps"])
            for (parameter, average, square), gradient in zip(self._flat, gradients, strict=True):
                compiled_adam.descend(parameter, _flat(gradient), average, square, *constants)
            return
        torch._fused_adam_(
            group["params"],
            gradients,
            averages,
            squares,
            [],
            steps,
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


def _flat(tensor: torch.Tensor) -> np.ndarray:
    """The numbers of a tensor one after another; of a contiguous one in its own memory."""
    array: np.ndarray = tensor.detach().numpy().reshape(-1)
    return array
