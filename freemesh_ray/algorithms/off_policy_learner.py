"""k gradient steps on k minibatches in one call, each with its gradients written out."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import torch
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.core.columns import Columns

from freemesh_ray.algorithms.adam import LeanAdam
from freemesh_ray.algorithms.configured_learner import ConfiguredLearner


class OffPolicyLearner(ConfiguredLearner):
    """Updates a module from batches of k x ``train_batch_size_per_learner`` transitions.

    A subclass says what is optimised (``optimised``) and what a step is (``_step``).
    """

    @abstractmethod
    def optimised(self, module: Any, config: Any) -> dict[str, tuple[list[torch.Tensor], float]]:
        """Parameters and learning rate of each optimizer, by its name."""

    @abstractmethod
    def _step(
        self,
        module_id: str,
        config: Any,
        obs: torch.Tensor,
        actions: torch.Tensor,
        rewards: torch.Tensor,
        next_obs: torch.Tensor,
        terminated: torch.Tensor,
    ) -> dict[str, torch.Tensor]:
        """One gradient step on one minibatch; figures by name, losses ending in ``_loss``."""

    def configure_optimizers_for_module(self, module_id: str, config: AlgorithmConfig | None = None) -> None:
        """One fused Adam for each of ``optimised``."""
        for name, (parameters, rate) in self.optimised(self._module[module_id], config or self.config).items():
            self.register_optimizer(
                module_id=module_id,
                optimizer_name=name,
                optimizer=LeanAdam(parameters, lr=rate),
                params=parameters,
                lr_or_lr_schedule=rate,
            )

    def build(self) -> None:
        """Build module, optimizers and the source of the steps' noise."""
        super().build()
        self._noise = torch.Generator().manual_seed(self.config.seed or 0)

    def compute_loss_for_module(self, **kwargs: Any) -> Any:
        """Not how this learner works: ``_update`` takes each loss's gradient on its own."""
        raise TypeError(f"{type(self).__name__} updates in _update; it has no single loss")

    def get_state(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """The learner's state with the random state of its noise."""
        return super().get_state(*args, **kwargs) | {"noise": self._noise.get_state().numpy()}

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state."""
        super().set_state(state)
        if "noise" in state:
            self._noise.set_state(torch.from_numpy(state["noise"]))

    @torch.no_grad()
    def _update(self, batch: dict[str, Any], **kwargs: Any) -> tuple[Any, dict[str, Any], Any]:
        losses: dict[str, Any] = {}
        for module_id, rows in batch.items():
            config = self.config.get_config_for_module(module_id)
            size = config.train_batch_size_per_learner
            columns = [
                rows[key].split(size)
                for key in (Columns.OBS, Columns.ACTIONS, Columns.REWARDS, Columns.NEXT_OBS, Columns.TERMINATEDS)
            ]
            figures: dict[str, torch.Tensor] = {}
            for minibatch in zip(*columns, strict=True):
                figures |= self._step(module_id, config, *minibatch)
            # Those of the last minibatch: reducing every one's would cost as much as an optimizer.
            values = {name: float(figure.mean()) for name, figure in figures.items()}
            self.metrics.log_dict(values, key=module_id, window=1)
            losses[module_id] = torch.tensor(sum(values[name] for name in values if name.endswith("_loss")))
        return {}, losses, {}

    def _descend(self, module_id: str, name: str, parameters: list[Any], gradients: Any) -> None:
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient
        self._named_optimizers[f"{module_id}_{name}"].step()
