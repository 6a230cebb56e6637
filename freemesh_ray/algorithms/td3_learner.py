"""TD3's arithmetic, and with one critic, no delay and no smoothing DDPG's.

A step is what Fujimoto et al. (2018, algorithm 1) and Stable-Baselines3 do, in their order: critics, and every
``policy_delay``-th time actor and targets.
"""

from __future__ import annotations

from typing import Any

import torch

from freemesh_ray.algorithms.off_policy_learner import OffPolicyLearner
from freemesh_ray.algorithms.td3_module import TD3Module


class TD3Learner(OffPolicyLearner):
    """Updates a TD3Module."""

    def build(self) -> None:
        """Build module and optimizers; no step is taken yet."""
        super().build()
        self._steps = 0
        #: The loss of the actor's last step, told until its next one; nothing before its first.
        self._actor_figures: dict[str, torch.Tensor] = {}

    def optimised(self, module: TD3Module, config: Any) -> dict[str, tuple[list[torch.Tensor], float]]:
        """Critics and actor."""
        return {
            "critic": (list(module.critic.parameters()), config.critic_lr),
            "actor": (list(module.actor.parameters()), config.actor_lr),
        }

    def draws(self, config: Any) -> int:
        """For the target's action, if that is smoothed."""
        return int(config.target_noise > 0)

    def get_state(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """The learner's state with its count of steps, which the delay depends on, and what is told meanwhile."""
        told = {name: float(figure) for name, figure in self._actor_figures.items()}
        return super().get_state(*args, **kwargs) | {"steps": self._steps, "actor_figures": told}

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state."""
        super().set_state(state)
        self._steps = state.get("steps", self._steps)
        told = state.get("actor_figures", {})
        self._actor_figures = {name: torch.tensor(figure, device=self._device) for name, figure in told.items()}

    def _step(
        self,
        module_id: str,
        config: Any,
        obs: torch.Tensor,
        actions: torch.Tensor,
        rewards: torch.Tensor,
        next_obs: torch.Tensor,
        terminated: torch.Tensor,
        noise: torch.Tensor,
    ) -> dict[str, torch.Tensor]:
        module: TD3Module = self._module[module_id]
        critic_parameters: list[torch.Tensor] = list(module.critic.parameters())
        size = len(obs)

        # The squared Bellman residual of each critic against the smallest target at a smoothed target action
        next_actions = module.target_actor(next_obs).tanh()
        if config.target_noise:
            smoothing = (config.target_noise * noise[0]).clamp_(-config.target_noise_clip, config.target_noise_clip)
            next_actions = (next_actions + smoothing).clamp_(-1.0, 1.0)
        next_q = module.target_critic(torch.cat([next_obs, next_actions], dim=1)).amin(dim=0).squeeze(1)
        target = rewards + config.gamma * (1.0 - terminated) * next_q
        critic_trace = module.critic.trace(torch.cat([obs, actions], dim=1))
        residual = critic_trace[-1] - target.unsqueeze(1)
        d_q = residual * (2.0 / size)
        self._descend(module_id, "critic", critic_parameters, module.critic.backward(critic_trace, d_q))
        figures = {"critic_loss": residual.square().sum() / size, "q_mean": critic_trace[-1]}

        self._steps += 1
        if self._steps % config.policy_delay:
            return figures | self._actor_figures

        # The deterministic policy gradient: -Q of the first critic, just updated
        actor_parameters: list[torch.Tensor] = list(module.actor.parameters())
        actor_trace = module.actor.trace(obs)
        new_actions = actor_trace[-1].tanh()
        q_trace = module.critic.trace(torch.cat([obs, new_actions], dim=1))
        d_q = torch.zeros_like(q_trace[-1])
        d_q[0] = -1.0 / size
        d_action = module.critic.backward_to_input(q_trace, d_q)[:, obs.shape[1] :]
        d_outputs = d_action * (1.0 - new_actions.square())
        self._descend(module_id, "actor", actor_parameters, module.actor.backward(actor_trace, d_outputs))

        targets: list[torch.Tensor] = [*module.target_critic.parameters(), *module.target_actor.parameters()]
        torch._foreach_lerp_(targets, critic_parameters + actor_parameters, config.tau)
        self._actor_figures = {"actor_loss": -q_trace[-1][0].mean()}
        return figures | self._actor_figures
