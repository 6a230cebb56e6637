"""SAC's gradient steps in `compiled_sac`, from and to the learner's networks and optimizers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from freemesh_ray.algorithms import compiled_sac
from freemesh_ray.algorithms.adam import LeanAdam, flat
from freemesh_ray.algorithms.alignment import aligned_zeros
from freemesh_ray.algorithms.compiled_mlp import CompiledMlp
from freemesh_ray.algorithms.compiled_sac import Experience, Moments, Settings, Work


class SacSteps:
    """Many steps in one call.

    Args:
        networks: ``actor``, ``critic`` and ``target_critic``.
        optimizers: ``actor``, ``critic`` and ``alpha``.
        log_alpha: (1,).
        rows: of a minibatch, a multiple of `block_products.BLOCK`.
    """

    def __init__(
        self,
        networks: Mapping[str, CompiledMlp],
        optimizers: Mapping[str, LeanAdam],
        log_alpha: torch.Tensor,
        rows: int,
    ) -> None:
        self._networks, self._optimizers, self._log_alpha = networks, optimizers, log_alpha
        actor, critic = networks["actor"], networks["critic"]
        observed = int(actor.network.sizes[0])
        width = int(critic.network.sizes[0]) - observed
        count = len(critic.network.last)
        actor_values, critic_values = actor.values(2 * rows).reshape(-1), critic.values(rows)
        larger = actor if len(actor.row) > len(critic.row) else critic
        self._work = Work(
            states=_floats(2 * rows, observed),
            pairs=_floats(rows, observed + width),
            actor_values=actor_values,
            actor_int32=actor_values.view(np.int32),
            outputs=_floats(2 * rows, 2 * width),
            sampled=_floats(2 * rows * width),
            log_std=_floats(2 * rows * width),
            log_pi=_floats(2 * rows),
            critic_values=critic_values,
            critic_int32=critic_values.view(np.int32),
            q=_floats(count, rows, 1),
            next_q=_floats(count, rows, 1),
            d_q=_floats(count, rows, 1),
            d_pairs=_floats(rows, int(critic.network.widths[0])),
            d_action=_floats(rows, width),
            d_outputs=_floats(1, rows, 2 * width),
            actor_rooms=actor.rooms(rows),
            critic_rooms=critic.rooms(rows),
            room=actor.room if len(actor.room) > len(critic.room) else critic.room,
            row=larger.row,
            processor=actor.processor,
        )
        self._gradients = [_floats(len(networks[name].network.parameters)) for name in ("critic", "actor")]
        self._gradients.append(_floats(1))

    def steps(self, minibatches: Any, first: int, config: Any, target_entropy: float) -> dict[str, float]:
        """Make a step on each of several minibatches; the figures of the last, and of the last turn of the actor's.

        Args:
            minibatches: a ``Minibatch`` that holds the rows of all of them, and their noise with an axis in front.
            first: the number of the first step, from 1 on.
            config: of the module.
            target_entropy: nats.
        """
        optimizers = [self._optimizers[name] for name in ("critic", "actor", "alpha")]
        group = optimizers[0].param_groups[0]
        moments = [optimizer.moments for optimizer in optimizers]
        taken = np.array([one.steps for one in moments])
        before = taken.copy()
        figures = np.full(len(compiled_sac.FIGURES), np.nan)
        critic, actor, alpha = (
            Moments(flat(one.average), flat(one.square), gradient)
            for one, gradient in zip(moments, self._gradients, strict=True)
        )
        critic_rate, actor_rate, alpha_rate = (optimizer.param_groups[0]["lr"] for optimizer in optimizers)
        compiled_sac.steps(
            Experience(*(tensor.contiguous().numpy() for tensor in minibatches)),
            first,
            Settings(
                delay=config.policy_delay,
                tau=np.float32(config.tau),
                target_entropy=np.float32(target_entropy),
                rates=(critic_rate, actor_rate, alpha_rate),
                beta1=group["betas"][0],
                beta2=group["betas"][1],
                eps=group["eps"],
            ),
            self._networks["actor"].network,
            self._networks["critic"].network,
            self._networks["target_critic"].network,
            flat(self._log_alpha),
            (critic, actor, alpha),
            taken,
            self._work,
            figures,
        )
        for one, steps in zip(moments, (taken - before).tolist(), strict=True):
            one.advance(steps)
        for network in self._networks.values():
            network.write()
        turned = taken[1] > before[1]
        told = compiled_sac.FIGURES if turned else compiled_sac.FIGURES[:3]
        return dict(zip(told, figures.tolist(), strict=False))


def _floats(*shape: int) -> np.ndarray:
    return aligned_zeros(shape, np.float32)
