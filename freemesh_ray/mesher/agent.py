"""A policy in compiled code: what it sees, what it would do, and what it thinks of an action."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inlined, inner
from envs.mdp.action import Cut
from envs.mdp.front import Front
from envs.mdp.observation import observation_size, observe
from envs.mdp.transition import Numbers, terms
from envs.types import Floats
from freemesh_ray.mesher.forward_pass import Network, forward, pack
from freemesh_ray.policies.policy import LOG_STD_MAX, LOG_STD_MIN, Policy, check_unaltered


class Agent(NamedTuple):
    """Networks and their working memory.

    Attributes:
        actor: observation -> mean and log deviation before tanh.
        critic_1, critic_2: observation and action -> value; of no meaning without ``judges``.
        judges: whether there are critics.
        size: length of the actor's actions, 3 or 5.
        limits: (2,) float64, bounds of the log deviation.
        observation: (observation size,) float32, of the vertex looked at last.
        outputs: (2 size,) float32, the actor's, there.
        question, answer: float32, the critics' input and output.
    """

    actor: Network
    critic_1: Network
    critic_2: Network
    judges: bool
    size: int
    limits: Floats
    observation: np.ndarray
    outputs: np.ndarray
    question: np.ndarray
    answer: np.ndarray


def agent(policy: Policy) -> Agent:
    """The compiled view of a policy; a single critic stands for both of a pair.

    Raises:
        PolicyError: plug-ins alter what the policy sees or does.
    """
    check_unaltered(policy)
    inputs, size = observation_size(policy.parameters), policy.parameters.action_size
    nothing = [(np.zeros((inputs + size, 1)), np.zeros(1))]
    critics = (
        [[(w[i], b[i]) for w, b in policy.critic] for i in range(len(policy.critic[0][0]))] if policy.critic else []
    )
    return Agent(
        actor=pack(policy.layers),
        critic_1=pack(critics[0] if critics else nothing),
        critic_2=pack(critics[-1] if critics else nothing),
        judges=bool(critics),
        size=size,
        limits=np.array([LOG_STD_MIN, LOG_STD_MAX]),
        observation=np.zeros(inputs, dtype=np.float32),
        outputs=np.zeros(2 * size, dtype=np.float32),
        question=np.zeros(inputs + size, dtype=np.float32),
        answer=np.zeros(1, dtype=np.float32),
    )


@inner
def look(agent: Agent, front: Front, slot: int, numbers: Numbers) -> None:
    """Let the agent see the front from a slot, and run its actor."""
    observe(front, slot, numbers.n, numbers.g, numbers.beta, numbers.extended, numbers.sized, agent.observation)
    forward(agent.actor, agent.observation, agent.outputs)


@inlined
def mean_action(agent: Agent, action: Floats) -> None:
    """The deterministic action for what the agent sees."""
    for i in range(agent.size):
        action[i] = math.tanh(agent.outputs[i])


@inlined
def sampled_action(agent: Agent, random: np.random.Generator, action: Floats) -> None:
    """An action drawn from the policy for what the agent sees."""
    for i in range(agent.size):
        log_std = min(max(agent.outputs[agent.size + i], agent.limits[0]), agent.limits[1])
        action[i] = math.tanh(agent.outputs[i] + math.exp(log_std) * random.standard_normal())


@inner
def value(agent: Agent, action: Floats) -> float:
    """The lesser of the critics' values of an action for what the agent sees."""
    inputs = len(agent.observation)
    for i in range(inputs):
        agent.question[i] = agent.observation[i]
    for i in range(agent.size):
        agent.question[inputs + i] = action[i]
    forward(agent.critic_1, agent.question, agent.answer)
    least = agent.answer[0]
    forward(agent.critic_2, agent.question, agent.answer)
    return min(least, agent.answer[0])


@inlined
def immediate_reward(front: Front, cut: Cut, numbers: Numbers) -> float:
    """eta_e + eta_b + mu, and nu where it counts, of an accepted element."""
    quality, boundary, density, irregularity = terms(front, cut, numbers)
    return quality + boundary + density + irregularity
