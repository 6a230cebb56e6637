"""SAC's arithmetic (paper, section "Meshing scheme via SAC").

A step is what Haarnoja et al. (2018b) and Stable-Baselines3 do, in their order: temperature, critics, actor, targets.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import torch

from freemesh_ray.algorithms import compiled_gaussian, squashed_gaussian
from freemesh_ray.algorithms.block_products import BLOCK
from freemesh_ray.algorithms.compiled_mlp import CompiledMlp
from freemesh_ray.algorithms.networks import on_cpu
from freemesh_ray.algorithms.off_policy_learner import Figures, Minibatch, OffPolicyLearner
from freemesh_ray.algorithms.sac_module import SACModule
from freemesh_ray.algorithms.sac_steps import SacSteps


class SACLearner(OffPolicyLearner):
    """Updates a SACModule."""

    def optimised(self, module: SACModule, config: Any) -> dict[str, tuple[list[torch.Tensor], float]]:
        """Critics, actor and temperature."""
        return {**super().optimised(module, config), "alpha": ([module.log_alpha], config.alpha_lr)}

    def losses(self, module: SACModule, config: Any, minibatch: Minibatch) -> Iterator[tuple[str, torch.Tensor]]:
        """J_Q(theta), and in the actor's turn J(alpha) before and J(phi) after it."""
        obs, actions, rewards, next_obs, discounts, noise = minibatch
        target_entropy = -float(actions.shape[1]) if config.target_entropy == "auto" else config.target_entropy
        alpha = module.log_alpha.exp().detach()
        turn = self._steps % config.policy_delay == 0

        if turn:
            new_actions, log_pi = squashed_gaussian.sample(module.actor(obs), noise[0])
            yield "alpha", -(module.log_alpha * (log_pi.detach() + target_entropy)).mean()

        with torch.no_grad():
            next_actions, next_log_pi = squashed_gaussian.sample(module.actor(next_obs), noise[1])
            next_value = module.target_q(next_obs, next_actions).amin(dim=0) - alpha * next_log_pi
            target = rewards + discounts * next_value
        yield "critic", 0.5 * (module.q(obs, actions) - target).square().mean(dim=1).sum()

        if turn:
            yield "actor", (alpha * log_pi - module.q(obs, new_actions).amin(dim=0)).mean()

    def _descend_all(self, module_id: str, config: Any, rows: Minibatch, size: int) -> Figures:
        """In one kernel where the networks are compiled."""
        evaluated = self._networks(module_id)
        networks = {name: network for name, network in evaluated.items() if isinstance(network, CompiledMlp)}
        is_own = getattr(self._step, "__func__", None) is SACLearner._step
        if len(networks) < len(evaluated) or not is_own or config.layer_norm or self.distributed or size % BLOCK:
            return super()._descend_all(module_id, config, rows, size)
        if module_id not in self._compiled:
            optimizers = {name: self._named_optimizers[f"{module_id}_{name}"] for name in ("actor", "critic", "alpha")}
            self._compiled[module_id] = SacSteps(networks, optimizers, self._module[module_id].log_alpha, size)
        entropy = -float(rows.actions.shape[1]) if config.target_entropy == "auto" else config.target_entropy
        told = self._compiled[module_id].steps(rows, self._steps + 1, config, entropy)
        self._steps += len(rows.rewards) // size
        return {name: partial(torch.tensor, value) for name, value in told.items()}

    def build(self) -> None:
        """OffPolicyLearner's."""
        self._compiled: dict[str, SacSteps] = {}
        super().build()

    def _step(self, module_id: str, config: Any, minibatch: Minibatch) -> Figures:
        """The same with its gradients written out."""
        obs, actions, rewards, next_obs, discounts, noise = minibatch
        module: SACModule = self._module[module_id]
        networks = self._networks(module_id)
        actor, critic, target_critic = (networks[name] for name in ("actor", "critic", "target_critic"))
        alpha = module.log_alpha.exp()
        target_entropy = -float(actions.shape[1]) if config.target_entropy == "auto" else config.target_entropy
        size = len(obs)
        turn = self._steps % config.policy_delay == 0
        gaussian = compiled_gaussian if on_cpu(obs) else squashed_gaussian
        figures: Figures = {"alpha": lambda: alpha}

        # The actor at s and s' in one pass; only at s' where it is not its turn
        if turn:
            trace = actor.trace(torch.cat([obs, next_obs]))
            drawn, log_density = gaussian.sample(trace[-1], noise.flatten(0, 1))
        else:
            drawn, log_density = gaussian.sample(actor(next_obs), noise[1])
        next_actions, next_log_pi = drawn[-size:], log_density[-size:]

        # J(alpha)
        if turn:
            new_actions, log_pi = drawn[:size], log_density[:size]
            alpha_gradient = -(log_pi.mean() + target_entropy).reshape(1)
            figures |= {"alpha_loss": lambda: alpha.log() * alpha_gradient, "log_pi_mean": lambda: log_pi}
            self._descend(module_id, "alpha", [alpha_gradient])

        # J_Q(theta): half the squared soft Bellman residual of each critic against the target critics
        next_q = target_critic(torch.cat([next_obs, next_actions], dim=1)).amin(dim=0).squeeze(1)
        target = rewards + discounts * (next_q - alpha * next_log_pi)
        critic_trace = critic.trace(torch.cat([obs, actions], dim=1))
        residual = critic_trace[-1] - target.unsqueeze(1)
        self._descend(module_id, "critic", critic.backward(critic_trace, residual / size))
        figures |= {
            "critic_loss": lambda: 0.5 * residual.square().sum() / size,
            "q_mean": lambda: critic_trace[-1],
        }

        # J(phi), with the critics just updated: alpha log pi - min Q, the gradient through the smaller critic only
        if turn:
            q_trace = critic.trace(torch.cat([obs, new_actions], dim=1))
            q_new, smaller = q_trace[-1].min(dim=0, keepdim=True)
            d_q = torch.zeros_like(q_trace[-1]).scatter_(0, smaller, -1.0 / size)
            d_action = critic.backward_to_input(q_trace, d_q)[:, obs.shape[1] :]
            actor_trace = [part[:size] for part in trace]
            d_outputs = gaussian.backward(actor_trace[-1], noise[0], new_actions, d_action, alpha / size)
            self._descend(module_id, "actor", actor.backward(actor_trace, d_outputs))
            figures["actor_loss"] = lambda: alpha * log_pi.mean() - q_new.mean()

        self._follow(module_id, config)
        return figures
