"""TD3's arithmetic, and with one critic, no delay and no smoothing DDPG's.

A step is what Fujimoto et al. (2018, algorithm 1) and Stable-Baselines3 do, in their order: critics, and every
``policy_delay``-th time actor and targets.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch

from freemesh_ray.algorithms.off_policy_learner import Figures, Minibatch, OffPolicyLearner
from freemesh_ray.algorithms.td3_module import TD3Module


class TD3Learner(OffPolicyLearner):
    """Updates a TD3Module."""

    TARGETS_WAIT = True

    def draws(self, config: Any) -> int:
        """For the target's action, if that is smoothed."""
        return int(config.target_noise > 0)

    def losses(self, module: TD3Module, config: Any, minibatch: Minibatch) -> Iterator[tuple[str, torch.Tensor]]:
        """The critics', and in its turn the deterministic policy's."""
        obs, actions, rewards, next_obs, discounts, noise = minibatch
        with torch.no_grad():
            next_actions = module.target_actor(next_obs).tanh()
            if config.target_noise:
                limit = config.target_noise_clip
                next_actions = (next_actions + (config.target_noise * noise[0]).clamp(-limit, limit)).clamp(-1.0, 1.0)
            next_value = module.target_q(next_obs, next_actions).amin(dim=0)
            target = rewards + discounts * next_value
        yield "critic", (module.q(obs, actions) - target).square().mean(dim=1).sum()

        if self._steps % config.policy_delay == 0:
            yield "actor", -module.q(obs, module.actor(obs).tanh())[0].mean()

    def _step(self, module_id: str, config: Any, minibatch: Minibatch) -> Figures:
        """The same with its gradients written out."""
        obs, actions, rewards, next_obs, discounts, noise = minibatch
        networks = self._networks(module_id)
        actor, critic = networks["actor"], networks["critic"]
        size = len(obs)

        # The squared Bellman residual of each critic against the smallest target at a smoothed target action
        next_actions = networks["target_actor"](next_obs).tanh()
        if config.target_noise:
            smoothing = (config.target_noise * noise[0]).clamp_(-config.target_noise_clip, config.target_noise_clip)
            next_actions = (next_actions + smoothing).clamp_(-1.0, 1.0)
        next_q = networks["target_critic"](torch.cat([next_obs, next_actions], dim=1)).amin(dim=0).squeeze(1)
        target = rewards + discounts * next_q
        critic_trace = critic.trace(torch.cat([obs, actions], dim=1))
        residual = critic_trace[-1] - target.unsqueeze(1)
        d_q = residual * (2.0 / size)
        self._descend(module_id, "critic", critic.backward(critic_trace, d_q))
        figures: Figures = {
            "critic_loss": lambda: residual.square().sum() / size,
            "q_mean": lambda: critic_trace[-1],
        }

        if self._steps % config.policy_delay:
            return figures

        # The deterministic policy gradient: -Q of the first critic, just updated
        actor_trace = actor.trace(obs)
        new_actions = actor_trace[-1].tanh()
        q_trace = critic.trace(torch.cat([obs, new_actions], dim=1))
        d_q = torch.zeros_like(q_trace[-1])
        d_q[0] = -1.0 / size
        d_action = critic.backward_to_input(q_trace, d_q)[:, obs.shape[1] :]
        d_outputs = d_action * (1.0 - new_actions.square())
        self._descend(module_id, "actor", actor.backward(actor_trace, d_outputs))

        self._follow(module_id, config)
        return figures | {"actor_loss": lambda: -q_trace[-1][0].mean()}
