"""SAC's arithmetic: k gradient steps on k minibatches in one call (paper, section "Meshing scheme via SAC").

A step is what Haarnoja et al. (2018b) and Stable-Baselines3 do, in their order: temperature, critics, actor, targets.
"""

from __future__ import annotations

from typing import Any

import torch
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.core.columns import Columns
from ray.rllib.core.learner.torch.torch_learner import TorchLearner

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

    @torch.no_grad()
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
        alpha = float(module.log_alpha.detach().exp())
        target_entropy = -float(actions.shape[1]) if config.target_entropy == "auto" else config.target_entropy
        size = len(obs)

        # J(alpha)
        actor_trace = module.actor.trace(obs)
        new_actions, log_pi = squashed_gaussian.sample(actor_trace[-1], noise[0])
        alpha_gradient = -(log_pi.mean() + target_entropy).reshape(1)
        alpha_loss = module.log_alpha * alpha_gradient
        self._descend(module_id, "alpha", [module.log_alpha], [alpha_gradient])

        # J_Q(theta): half the squared soft Bellman residual of each critic against the target critics
        next_actions, next_log_pi = squashed_gaussian.sample(module.actor(next_obs), noise[1])
        next_q = module.target_critic(torch.cat([next_obs, next_actions], dim=1)).amin(dim=0).squeeze(1)
        target = rewards + config.gamma * (1.0 - terminated) * (next_q - alpha * next_log_pi)
        critic_trace = module.critic.trace(torch.cat([obs, actions], dim=1))
        residual = critic_trace[-1] - target.unsqueeze(1)
        self._descend(
            module_id, "critic", self._critic_parameters(module), module.critic.backward(critic_trace, residual / size)
        )

        # J(phi), with the critics just updated: alpha log pi - min Q, the gradient through the smaller critic only
        q_trace = module.critic.trace(torch.cat([obs, new_actions], dim=1))
        q_new, smaller = q_trace[-1].min(dim=0, keepdim=True)
        d_q = torch.zeros_like(q_trace[-1]).scatter_(0, smaller, -1.0 / size)
        d_action = module.critic.backward_to_input(q_trace, d_q)[:, obs.shape[1] :]
        d_outputs = squashed_gaussian.backward(actor_trace[-1], noise[0], new_actions, d_action, alpha / size)
        self._descend(
            module_id, "actor", list(module.actor.parameters()), module.actor.backward(actor_trace, d_outputs)
        )

        targets: list[torch.Tensor] = list(module.target_critic.parameters())
        torch._foreach_lerp_(targets, self._critic_parameters(module), config.tau)
        critic_loss = 0.5 * residual.square().sum() / size
        actor_loss = alpha * log_pi.mean() - q_new.mean()
        return [critic_loss, actor_loss, alpha_loss, torch.tensor(alpha), critic_trace[-1], log_pi]

    @staticmethod
    def _critic_parameters(module: SACModule) -> list[torch.Tensor]:
        return list(module.critic.parameters())

    def _descend(self, module_id: str, name: str, parameters: list[Any], gradients: Any) -> None:
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient
        self._named_optimizers[f"{module_id}_{name}"].step()
