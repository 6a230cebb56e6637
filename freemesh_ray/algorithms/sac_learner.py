"""SAC's arithmetic: k gradient steps on k minibatches in one call (paper, section "Meshing scheme via SAC").

A step is what Haarnoja et al. (2018b) and Stable-Baselines3 do, in their order: temperature, critics, actor, targets.
"""

from __future__ import annotations

from typing import Any

import torch
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.core.columns import Columns
from ray.rllib.core.learner.torch.torch_learner import TorchLearner
from torch.nn.functional import mse_loss

from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.algorithms.adam import LeanAdam
from freemesh_ray.algorithms.sac_module import SACModule

#: Names of the figures that an update reports.
FIGURES = ("critic_loss", "actor_loss", "alpha_loss", "alpha", "q_mean", "log_pi_mean")


class SACLearner(TorchLearner):
    """Updates SACModule from batches of k x ``batch_size`` transitions."""

    def configure_optimizers_for_module(self, module_id: str, config: AlgorithmConfig | None = None) -> None:
        """One fused Adam each for actor, critics and temperature."""
        config = config or self.config
        module: SACModule = self._module[module_id]
        for name, parameters, rate in (
            ("critic", list(module.critic.parameters()), config.critic_lr),
            ("actor", list(module.actor.parameters()), config.actor_lr),
            ("alpha", [module.log_alpha], config.alpha_lr),
        ):
            self.register_optimizer(
                module_id=module_id,
                optimizer_name=name,
                optimizer=LeanAdam(parameters, lr=rate),
                params=parameters,
                lr_or_lr_schedule=rate,
            )

    def build(self) -> None:
        """Build module and optimizers; one thread, so that processes do not fight for cores."""
        torch.set_num_threads(1)
        super().build()
        self._noise = torch.Generator().manual_seed(self.config.seed or 0)

    def compute_loss_for_module(self, **kwargs: Any) -> Any:
        """Not how this learner works: ``_update`` takes each loss's gradient on its own."""
        raise TypeError("SACLearner updates in _update; it has no single loss")

    def get_state(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """The learner's state with the random state of the policy's noise."""
        return super().get_state(*args, **kwargs) | {"noise": self._noise.get_state().numpy()}

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state."""
        super().set_state(state)
        if "noise" in state:
            self._noise.set_state(torch.from_numpy(state["noise"]))

    def _update(self, batch: dict[str, Any], **kwargs: Any) -> tuple[Any, dict[str, Any], Any]:
        losses: dict[str, Any] = {}
        for module_id, rows in batch.items():
            config = self.config.get_config_for_module(module_id)
            size = config.train_batch_size_per_learner
            columns = [
                rows[key].split(size)
                for key in (Columns.OBS, Columns.ACTIONS, Columns.REWARDS, Columns.NEXT_OBS, Columns.TERMINATEDS)
            ]
            for minibatch in zip(*columns, strict=True):
                figures = self._step(module_id, config, *minibatch)
            # Those of the last minibatch: reducing every one's would cost as much as an optimizer.
            values = [float(figure.mean()) for figure in figures]
            self.metrics.log_dict(dict(zip(FIGURES, values, strict=True)), key=module_id, window=1)
            losses[module_id] = torch.tensor(values[0] + values[1] + values[2])
        return {}, losses, {}

    def _step(
        self,
        module_id: str,
        config: AlgorithmConfig,
        obs: torch.Tensor,
        actions: torch.Tensor,
        rewards: torch.Tensor,
        next_obs: torch.Tensor,
        terminated: torch.Tensor,
    ) -> list[torch.Tensor]:
        module: SACModule = self._module[module_id]
        noise = torch.randn((2, *actions.shape), generator=self._noise)
        alpha = module.log_alpha.detach().exp()
        target_entropy = -float(actions.shape[1]) if config.target_entropy == "auto" else config.target_entropy

        # J(alpha)
        new_actions, log_pi = squashed_gaussian.sample(module.actor(obs), noise[0])
        alpha_gradient = -(log_pi.detach() + target_entropy).mean(dim=0, keepdim=True)
        alpha_loss = module.log_alpha.detach() * alpha_gradient
        self._descend(module_id, "alpha", [module.log_alpha], [alpha_gradient])

        # J_Q(theta): the soft Bellman residual against the target critics
        with torch.no_grad():
            next_actions, next_log_pi = squashed_gaussian.sample(module.actor(next_obs), noise[1])
            next_q = module.target_critic(torch.cat([next_obs, next_actions], dim=1)).amin(dim=0).squeeze(1)
            target = rewards + config.gamma * (1.0 - terminated) * (next_q - alpha * next_log_pi)
        q = module.critic(torch.cat([obs, actions], dim=1)).squeeze(2)
        # Half the squared error of each critic; SB3's, and Haarnoja's Eq. (5).
        critic_loss = 0.5 * mse_loss(q, target.expand(2, -1), reduction="none").mean(dim=1).sum()
        critic_parameters = list(module.critic.parameters())
        self._descend(module_id, "critic", critic_parameters, torch.autograd.grad(critic_loss, critic_parameters))

        # J(phi), with the critics just updated
        for parameter in critic_parameters:
            parameter.requires_grad_(False)
        q_new = module.critic(torch.cat([obs, new_actions], dim=1)).amin(dim=0).squeeze(1)
        actor_loss = (alpha * log_pi - q_new).mean()
        actor_parameters = list(module.actor.parameters())
        self._descend(module_id, "actor", actor_parameters, torch.autograd.grad(actor_loss, actor_parameters))
        for parameter in critic_parameters:
            parameter.requires_grad_(True)

        with torch.no_grad():
            targets: list[torch.Tensor] = list(module.target_critic.parameters())
            torch._foreach_lerp_(targets, list[torch.Tensor](critic_parameters), config.tau)
        return [figure.detach() for figure in (critic_loss, actor_loss, alpha_loss, alpha, q, log_pi)]

    def _descend(self, module_id: str, name: str, parameters: list[Any], gradients: Any) -> None:
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient
        self._named_optimizers[f"{module_id}_{name}"].step()
