"""SAC's gradient steps in one kernel: many minibatches, and nothing between them that is not arithmetic.

The arithmetic is `SACLearner._step`'s, in the same order, with a `CompiledMlp`'s networks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels.jit import compiled_sums, inlined
from freemesh_ray.algorithms import compiled_adam, mlp_passes
from freemesh_ray.algorithms.compiled_gaussian import backward_rows, sample_rows
from freemesh_ray.algorithms.mlp_passes import Network, Rooms

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
#: What ``steps`` tells of the last minibatch, and of the last one in which the actor was updated.
FIGURES = ("alpha", "critic_loss", "q_mean", "alpha_loss", "log_pi_mean", "actor_loss")


class Experience(NamedTuple):
    """All minibatches, one after another, float32.

    Attributes:
        obs, actions, rewards, next_obs, discounts, noise: as of a ``Minibatch``.
    """

    obs: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    next_obs: np.ndarray
    discounts: np.ndarray
    noise: np.ndarray


class Settings(NamedTuple):
    """What does not change from step to step.

    Attributes:
        delay: critic updates for one update of policy and temperature.
        tau: share of a critic that its target takes over.
        target_entropy: nats.
        rates: learning rates of critics, actor and temperature.
        beta1, beta2, eps: of Adam.
    """

    delay: int
    tau: np.float32
    target_entropy: np.float32
    rates: tuple[float, float, float]
    beta1: float
    beta2: float
    eps: float


class Moments(NamedTuple):
    """Adam's averages of gradients and of their squares, (parameters,) float32, and room for a gradient."""

    average: np.ndarray
    square: np.ndarray
    gradient: np.ndarray


class Work(NamedTuple):
    """Room for what a step needs; rows are those of a minibatch, a multiple of `block_products.BLOCK`.

    Attributes:
        states: (2 rows, observation size), at s and s'.
        pairs: (rows, observation and action size).
        actor_values, actor_int32: ``values`` of the actor for twice the rows, flat, and the same in pairs.
        outputs: (2 rows, 2 action sizes), of the actor.
        sampled, log_std: (2 rows times action size,).
        log_pi: (2 rows,).
        critic_values, critic_int32: ``values`` of the critics, and the same in pairs.
        q, next_q, d_q: (critics, rows, 1).
        d_pairs: (rows, padded width of the critics' input).
        d_action: (rows, action size).
        d_outputs: (1, rows, 2 action sizes).
        actor_rooms, critic_rooms: of backward passes.
        room, row, processor: see `mlp_passes`.
    """

    states: np.ndarray
    pairs: np.ndarray
    actor_values: np.ndarray
    actor_int32: np.ndarray
    outputs: np.ndarray
    sampled: np.ndarray
    log_std: np.ndarray
    log_pi: np.ndarray
    critic_values: np.ndarray
    critic_int32: np.ndarray
    q: np.ndarray
    next_q: np.ndarray
    d_q: np.ndarray
    d_pairs: np.ndarray
    d_action: np.ndarray
    d_outputs: np.ndarray
    actor_rooms: Rooms
    critic_rooms: Rooms
    room: np.ndarray
    row: np.ndarray
    processor: np.ndarray


@inlined
def _copy(source: np.ndarray, first: int, found: np.ndarray, first_found: int, rows: int) -> None:
    """Rows of one matrix to those of another."""
    for i in range(rows):
        for k in range(source.shape[1]):
            found[first_found + i, k] = source[first + i, k]


@inlined
def _beside(source: np.ndarray, width: int, found: np.ndarray, first_column: int) -> None:
    """``source``, rows of that width in a row, into columns of ``found``."""
    for i in range(len(found)):
        for k in range(width):
            found[i, first_column + k] = source[i * width + k]


@inlined
def _smallest(q: np.ndarray, row: int) -> int:
    """Which critic's value is; one that is no number, before all others."""
    best = 0
    for n in range(1, len(q)):
        if not (q[n, row, 0] >= q[best, row, 0]) and q[best, row, 0] == q[best, row, 0]:
            best = n
    return best


@inlined
def _descend(parameters: np.ndarray, moments: Moments, taken: np.ndarray, which: int, settings: Settings) -> None:
    """Adam's step along the gradient in ``moments``; ``which`` of critics, actor and temperature it is."""
    taken[which] += 1
    compiled_adam.descend(
        parameters, moments.gradient, moments.average, moments.square, taken[which], settings.rates[which],
        settings.beta1, settings.beta2, settings.eps,
    )  # fmt: skip


@compiled_sums
def steps(
    experience: Experience,
    first: int,
    settings: Settings,
    actor: Network,
    critic: Network,
    target: Network,
    log_alpha: np.ndarray,
    moments: tuple[Moments, Moments, Moments],
    taken: np.ndarray,
    work: Work,
    figures: np.ndarray,
) -> None:
    """Make a step on each minibatch.

    Args:
        experience: all minibatches.
        first: steps made before, plus one.
        settings: what does not change.
        actor, critic, target, log_alpha: what is updated; log_alpha is (1,).
        moments, taken: of critics, actor and temperature; ``taken`` are Adam's steps so far.
        work: room.
        figures: (6,) float64, `FIGURES`.
    """
    room, row, processor = work.room, work.row, work.processor
    rows, observed, width = len(work.pairs), experience.obs.shape[1], experience.actions.shape[1]
    size = np.float32(rows)
    actor_widths = 0
    for k in range(len(actor.widths)):
        actor_widths += actor.widths[k]
    for batch in range(len(experience.rewards) // rows):
        at = batch * rows
        turn = (first + batch) % settings.delay == 0
        alpha = np.float32(math.exp(log_alpha[0]))
        figures[0] = alpha

        # The actor at s and s' in one pass; only at s' where it is not its turn
        count = 2 * rows if turn else rows
        if turn:
            _copy(experience.obs, at, work.states, 0, rows)
        _copy(experience.next_obs, at, work.states, count - rows, rows)
        values = work.actor_values[: count * actor_widths].reshape(1, count, actor_widths)
        outputs = work.outputs[:count]
        noise = experience.noise[batch].reshape(2 * rows, width)[2 * rows - count :]
        mlp_passes.forward(
            actor,
            work.states[:count],
            values,
            outputs.reshape(1, count, 2 * width),
            room,
            row,
            processor,
        )
        sample_rows(outputs, noise, work.log_std[: count * width], work.sampled, work.log_pi[:count])
        next_log_pi, next_actions = work.log_pi[count - rows : count], work.sampled[(count - rows) * width :]

        # J(alpha)
        mean_log_pi = 0.0
        if turn:
            for i in range(rows):
                mean_log_pi += work.log_pi[i]
            mean_log_pi /= rows
            alpha_gradient = -(np.float32(mean_log_pi) + settings.target_entropy)
            figures[3], figures[4] = log_alpha[0] * alpha_gradient, mean_log_pi
            moments[2].gradient[0] = alpha_gradient
            _descend(log_alpha, moments[2], taken, 2, settings)

        # J_Q(theta): half the squared soft Bellman residual of each critic against the target critics
        _copy(experience.next_obs, at, work.pairs, 0, rows)
        _beside(next_actions, width, work.pairs, observed)
        mlp_passes.forward(target, work.pairs, work.critic_values, work.next_q, room, row, processor)
        _copy(experience.obs, at, work.pairs, 0, rows)
        _beside(experience.actions[at : at + rows].reshape(rows * width), width, work.pairs, observed)
        mlp_passes.forward(critic, work.pairs, work.critic_values, work.q, room, row, processor)
        loss, total = 0.0, 0.0
        for i in range(rows):
            next_value = work.next_q[_smallest(work.next_q, i), i, 0] - alpha * next_log_pi[i]
            value = experience.rewards[at + i] + experience.discounts[at + i] * next_value
            for n in range(len(work.q)):
                residual = work.q[n, i, 0] - value
                work.d_q[n, i, 0] = residual / size
                loss += residual * residual
                total += work.q[n, i, 0]
        figures[1], figures[2] = 0.5 * loss / rows, total / (rows * len(work.q))
        mlp_passes.backward(
            critic, work.critic_values, work.critic_int32, work.d_q, moments[0].gradient, work.critic_rooms, room, row,
            processor,
        )  # fmt: skip
        _descend(critic.parameters, moments[0], taken, 0, settings)
        mlp_passes.read(critic)

        # J(phi), with the critics just updated: alpha log pi - min Q, the gradient through the smaller critic only
        if turn:
            _beside(work.sampled, width, work.pairs, observed)
            mlp_passes.forward(critic, work.pairs, work.critic_values, work.q, room, row, processor)
            total = 0.0
            for i in range(rows):
                best = _smallest(work.q, i)
                for n in range(len(work.q)):
                    work.d_q[n, i, 0] = -_ONE / size if n == best else _ZERO
                total += work.q[best, i, 0]
            mlp_passes.backward_to_input(
                critic,
                work.critic_values,
                work.d_q,
                work.d_pairs,
                work.critic_rooms,
                room,
                row,
                processor,
            )
            for i in range(rows):
                for k in range(width):
                    work.d_action[i, k] = work.d_pairs[i, observed + k]
            backward_rows(
                outputs[:rows], noise[:rows], work.sampled[: rows * width].reshape(rows, width), work.d_action,
                alpha / size, work.d_outputs[0],
            )  # fmt: skip
            length = rows * actor_widths
            mlp_passes.backward(
                actor, work.actor_values[:length].reshape(1, rows, actor_widths),
                work.actor_int32[: length // 2].reshape(1, rows, actor_widths // 2), work.d_outputs,
                moments[1].gradient, work.actor_rooms, room, row, processor,
            )  # fmt: skip
            _descend(actor.parameters, moments[1], taken, 1, settings)
            mlp_passes.read(actor)
            figures[5] = alpha * mean_log_pi - total / rows

        for i in range(len(target.parameters)):
            target.parameters[i] += settings.tau * (critic.parameters[i] - target.parameters[i])
        mlp_passes.read(target)
