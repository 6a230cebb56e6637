"""What a training round costs, from its parts measured alone: a model of `OffPolicy.training_step`.

A round is one after the other, and nothing overlaps: all runners sample their fragments, their answers come in, the
transitions are stored and the minibatches drawn, the learners update, the runners get the new weights. So its seconds
are the sum of the parts. Of N runners with E environments and fragments of F steps, S = N E F:

    sampling   F (a + b E) max(1, N / cores)                       a, b: of one step of all environments
    transport  latency + N call + S bytes / bandwidth               the answers, read one after another
    replay     S add + U S B draw                                   U updates an env step, B rows each
    update     U S (c + d B / L) max(1, L / cores)                  shared by L learners
               + [L > 0] latency + U S B bytes / bandwidth          their rows are sent to them
               + [L > 1] U S reduce                                 their gradients are averaged
    publish    once + N each

Without a number of cores every process has its own, as on a cluster. Then a round is  p + N q  with q > 0, and E F N
transitions in it: their rate cannot exceed E F / q, whatever the number of runners.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

#: What moves each part, by the settings' names.
MOVES = {
    "sampling": "more runners.count, or runners.envs_per_runner",
    "transport": "a larger runners.fragment, or runners.envs_per_runner: fewer calls for the same steps",
    "replay": "a smaller learner.updates_per_step, or learner.batch_size",
    "update": "a smaller learner.updates_per_step, learner.device: cuda, or more learner.count with a larger batch",
    "publish": "a larger runners.fragment, or runners.envs_per_runner: weights are sent once a round",
}


@dataclass(frozen=True)
class Costs:
    """The parts, each measured alone; all in seconds but the last two.

    Attributes:
        step_call, step_env: one step of a runner's environments, policy included, and more for each environment.
        latency: a call to remote processes and back, however many.
        call: more for each process that answers.
        byte: more for each byte of an answer or of a batch.
        add_row, draw_row: storing a transition, and drawing one for a minibatch.
        update_call, update_row: a minibatch, and more for each of its rows.
        reduce: averaging the gradients of a minibatch over several learners.
        publish_once, publish_runner: new weights, and more for each runner.
        transition_bytes: of one transition.
        weights_bytes: of the policy's weights.
    """

    step_call: float
    step_env: float
    latency: float
    call: float
    byte: float
    add_row: float
    draw_row: float
    update_call: float
    update_row: float
    reduce: float
    publish_once: float
    publish_runner: float
    transition_bytes: int
    weights_bytes: int


@dataclass(frozen=True)
class Setup:
    """The settings that a round depends on.

    Attributes:
        runners, envs, fragment: remote env runners, 1 or more; ``runners.envs_per_runner``; ``runners.fragment``.
        updates_per_step, batch, learners: ``learner.updates_per_step``, ``learner.batch_size``, ``learner.count``.
        cores: that all processes share; None: each has its own.
    """

    runners: int
    envs: int = 16
    fragment: int = 8
    updates_per_step: float = 0.5
    batch: int = 256
    learners: int = 0
    cores: int | None = None

    @property
    def steps(self) -> int:
        """Env steps of a round."""
        return self.runners * self.envs * self.fragment


@dataclass(frozen=True)
class Round:
    """What the model says of a round.

    Attributes:
        parts: seconds by part, in the order of a round.
        steps, updates: in it; updates are a mean.
    """

    parts: dict[str, float]
    steps: int
    updates: float

    @property
    def seconds(self) -> float:
        """Of the whole round."""
        return sum(self.parts.values())

    @property
    def samples_per_second(self) -> float:
        """Env steps a second."""
        return self.steps / self.seconds

    @property
    def updates_per_second(self) -> float:
        """Updates a second."""
        return self.updates / self.seconds

    @property
    def bottleneck(self) -> str:
        """The part that takes longest."""
        return max(self.parts, key=lambda part: self.parts[part])

    def share(self, part: str) -> float:
        """Of the round's seconds, [0, 1]."""
        return self.parts[part] / self.seconds


def round_of(costs: Costs, setup: Setup) -> Round:
    """The seconds of a round; see the module for the formula."""
    steps, updates = setup.steps, setup.steps * setup.updates_per_step
    crowding = max(1.0, setup.runners / setup.cores) if setup.cores else 1.0
    sharing = max(1.0, setup.learners / setup.cores) if setup.cores else 1.0
    rows = setup.batch / max(1, setup.learners)
    update = updates * (costs.update_call + costs.update_row * rows) * sharing
    if setup.learners > 0:
        update += costs.latency + updates * setup.batch * costs.transition_bytes * costs.byte
    if setup.learners > 1:
        update += updates * costs.reduce
    parts = {
        "sampling": setup.fragment * (costs.step_call + costs.step_env * setup.envs) * crowding,
        "transport": costs.latency + setup.runners * costs.call + steps * costs.transition_bytes * costs.byte,
        "replay": steps * costs.add_row + updates * setup.batch * costs.draw_row,
        "update": update,
        "publish": costs.publish_once + setup.runners * costs.publish_runner,
    }
    return Round(parts, steps, updates)


def most(costs: Costs, setup: Setup) -> float:
    """Env steps a second that any number of runners stays below, each process on a core of its own."""
    one, two = (round_of(costs, replace(setup, runners=runners, cores=None)) for runners in (1, 2))
    return one.steps / (two.seconds - one.seconds)


def enough(costs: Costs, setup: Setup, share: float = 0.9) -> float:
    """Runners that reach ``share``, in (0, 1), of ``most``: beyond them more hardly help. At least 1.

    From N s / (p + N q) = share s / q follows N = p / q share / (1 - share).
    """
    one, two = (round_of(costs, replace(setup, runners=runners, cores=None)).seconds for runners in (1, 2))
    q = two - one
    return max(1.0, (one - q) / q * share / (1.0 - share))
