"""What a training round costs, from its parts measured alone: a model of `OffPolicy.training_step`.

The env runners' answers come in, the transitions are stored and the minibatches drawn; then the learners update while
the runners already sample the next round's fragments; then the runners are sent the new weights. So a round's seconds
are the sum of its parts, but for sampling and updating, of which the shorter is hidden behind the longer. Of N runners
with E environments and fragments of F steps, S = N E F:

    sampling   F (a + b E) max(1, N / cores)                       a, b: of one step of all environments
    transport  latency + N call + S bytes / bandwidth               the answers, read one after another
    replay     S add + U S B draw                                   U updates an env step, B rows each
    update     U S (c + d B / L) max(1, L / cores)                  shared by L learners
               + [L > 0] latency + U S B bytes / bandwidth          their rows are sent to them
               + [L > 1] U S reduce                                 their gradients are averaged
    publish    once + N each                                        nobody waits until the runners have them
    a round    transport + replay + publish + max(sampling, update, work / cores)

where work is what all runners and learners do together, each alone on a core. Without a number of cores every process
has its own, as on a cluster.

Without overlap a round is the sum of all parts, and publishing waits for the runners. Without runners the training's
process samples: a round is the sum, of S = E F, with no transport.

The more runners, the more samples a second with a core for each, but never more than a limit: all parts but sampling
grow with their number.
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
#: So many runners that all which does not grow with them is beyond a float's digits.
COUNTLESS = 1 << 100


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
        publish_once, publish_runner: new weights until the runners have them, and more for each runner.
        send_once, send_runner: the same where nobody waits for the runners.
        publish_local: new weights where the training's process samples.
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
    send_once: float
    send_runner: float
    publish_local: float
    transition_bytes: int
    weights_bytes: int


@dataclass(frozen=True)
class Setup:
    """The settings that a round depends on.

    Attributes:
        runners, envs, fragment: remote env runners, 0: the training's process samples; ``runners.envs_per_runner``;
            ``runners.fragment``.
        updates_per_step, batch, learners: ``learner.updates_per_step``, ``learner.batch_size``, ``learner.count``.
        cores: that all processes share; None: each has its own.
        overlap: ``runners.overlap``.
    """

    runners: int
    envs: int = 16
    fragment: int = 8
    updates_per_step: float = 0.5
    batch: int = 256
    learners: int = 0
    cores: int | None = None
    overlap: bool = True

    @property
    def steps(self) -> int:
        """Env steps of a round."""
        return max(1, self.runners) * self.envs * self.fragment

    @property
    def overlaps(self) -> bool:
        """Whether runners sample while the learners update."""
        return self.overlap and self.runners > 0


@dataclass(frozen=True)
class Round:
    """What the model says of a round.

    Attributes:
        parts: seconds by part, in the order of a round.
        together: seconds from the first of sampling and updating to the last.
        steps, updates: in it; updates are a mean.
    """

    parts: dict[str, float]
    together: float
    steps: int
    updates: float

    @property
    def behind(self) -> tuple[str, str]:
        """The shorter of sampling and updating, and the longer, behind which it is hidden as far as it is."""
        sampling, update = self.parts["sampling"], self.parts["update"]
        return ("update", "sampling") if update < sampling else ("sampling", "update")

    @property
    def hidden(self) -> float:
        """Share, [0, 1], of the shorter one's seconds that the round does not wait for."""
        shorter, longer = (self.parts[part] for part in self.behind)
        return max(0.0, 1.0 - max(0.0, self.together - longer) / shorter)

    @property
    def waited(self) -> dict[str, float]:
        """Seconds that the round waits for each part: all of it, but for what is hidden."""
        shorter, longer = self.behind
        return {**self.parts, shorter: max(0.0, self.together - self.parts[longer])}

    @property
    def seconds(self) -> float:
        """Of the whole round."""
        return sum(self.waited.values())

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
        """The part that the round waits for longest."""
        waited = self.waited
        return max(waited, key=lambda part: waited[part])

    def share(self, part: str) -> float:
        """Of the round's seconds, [0, 1], what it waits for the part."""
        return self.waited[part] / self.seconds


def round_of(costs: Costs, setup: Setup) -> Round:
    """The seconds of a round; see the module for the formula."""
    steps, updates = setup.steps, setup.steps * setup.updates_per_step
    samplers, learners, cores = max(1, setup.runners), max(1, setup.learners), setup.cores
    sample = setup.fragment * (costs.step_call + costs.step_env * setup.envs)
    learn = updates * (costs.update_call + costs.update_row * setup.batch / learners)
    exchange = 0.0
    if setup.learners > 0:
        exchange += costs.latency + updates * setup.batch * costs.transition_bytes * costs.byte
    if setup.learners > 1:
        exchange += updates * costs.reduce
    sampling = sample * max(1.0, samplers / cores if cores else 0.0)
    update = learn * max(1.0, learners / cores if cores else 0.0) + exchange
    together = sampling + update
    if setup.overlaps:
        work = samplers * sample + learners * learn + exchange
        together = max(sampling, update, work / cores if cores else 0.0)
    parts = {
        "sampling": sampling,
        "transport": transport(costs, setup),
        "replay": steps * costs.add_row + updates * setup.batch * costs.draw_row,
        "update": update,
        "publish": publish(costs, setup),
    }
    return Round(parts, together, steps, updates)


def transport(costs: Costs, setup: Setup) -> float:
    """Seconds until the training's process has what remote runners sampled."""
    if setup.runners == 0:
        return 0.0
    return costs.latency + setup.runners * costs.call + setup.steps * costs.transition_bytes * costs.byte


def publish(costs: Costs, setup: Setup) -> float:
    """Seconds that new weights for whoever samples hold up the training's process."""
    if setup.runners == 0:
        return costs.publish_local
    if setup.overlap:
        return costs.send_once + setup.runners * costs.send_runner
    return costs.publish_once + setup.runners * costs.publish_runner


def most(costs: Costs, setup: Setup) -> float:
    """Env steps a second that any number of runners stays below, each process on a core of its own."""
    return _speed(costs, setup, COUNTLESS)


def enough(costs: Costs, setup: Setup, share: float = 0.9) -> int:
    """The fewest runners that reach ``share``, in (0, 1), of ``most``: beyond them more hardly help. At least 1."""
    wanted = share * most(costs, setup)
    few, many = 0, 1
    while _speed(costs, setup, many) < wanted:
        few, many = many, 2 * many
    while many - few > 1:
        middle = (few + many) // 2
        few, many = (middle, many) if _speed(costs, setup, middle) < wanted else (few, middle)
    return many


def hides(costs: Costs, setup: Setup) -> float:
    """Updates an env step above which one runner's sampling is hidden behind its updates, the learner in its process.

    It is updates a second over samples a second, each of a process that does nothing else. So with U updates a step,
    ``hides`` / U runners sample as long as their steps are learnt from.
    """
    updates = 1.0 / (costs.update_call + costs.update_row * setup.batch)
    return updates / (setup.envs / (costs.step_call + costs.step_env * setup.envs))


def _speed(costs: Costs, setup: Setup, runners: int) -> float:
    return round_of(costs, replace(setup, runners=runners, cores=None)).samples_per_second
