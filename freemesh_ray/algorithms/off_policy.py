"""Learning from a replay buffer: collect from all env runners, store, update as often as is owed, publish weights."""

from __future__ import annotations

from typing import Any

import numpy as np
from ray.rllib.core.columns import Columns
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID, MultiAgentBatch, SampleBatch
from ray.rllib.utils.metrics import NUM_ENV_STEPS_SAMPLED_LIFETIME

from freemesh_ray.algorithms.env_runner import Collected
from freemesh_ray.algorithms.mesh_algorithm import MeshAlgorithm, MeshConfig
from freemesh_ray.algorithms.replay_buffer import ReplayBuffer, Transitions

ROLLOUTS = "rollouts"
REPLAY_BUFFER = "replay_buffer"


class OffPolicyConfig(MeshConfig):
    """What the algorithms with a replay buffer have in common; the numbers are those of the paper's table.

    Besides MeshConfig's settings: ``updates_per_step`` (gradient steps for each env step), ``warmup_steps`` (uniform
    actions, no updates).
    """

    OWN = (*MeshConfig.OWN, "updates_per_step", "warmup_steps")

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class)
        self.tau = 5e-3
        self.actor_lr = self.critic_lr = 3e-4
        self.train_batch_size_per_learner = 256
        self.replay_buffer_config: dict[str, Any] = {"type": "EpisodeReplayBuffer", "capacity": 1_000_000}
        self.updates_per_step = 1.0
        self.warmup_steps = 5_000
        self.rollout_fragment_length = 8

    def validate(self) -> None:
        """RLlib's checks, and those of the settings above.

        Raises:
            ValueError: a setting that these algorithms would silently ignore.
        """
        super().validate()
        if self.updates_per_step <= 0:
            raise ValueError(f"updates_per_step = {self.updates_per_step}: must be above 0")
        if self.warmup_steps < 1:
            raise ValueError(f"warmup_steps = {self.warmup_steps}: must be at least 1")


def dealt(rows: Transitions, minibatches: int, learners: int) -> list[Transitions]:
    """Consecutive minibatches, each cut into equal parts: the i-th parts of all, for each learner i."""

    def part(column: np.ndarray, i: int) -> np.ndarray:
        return column.reshape(minibatches, learners, -1, *column.shape[1:])[:, i].reshape(-1, *column.shape[1:])

    return [Transitions(*(part(column, i) for column in rows)) for i in range(learners)]


def batch(rows: Transitions) -> MultiAgentBatch:
    """Transitions as a learner takes them."""
    columns = {
        Columns.OBS: rows.obs,
        Columns.ACTIONS: rows.actions,
        Columns.REWARDS: rows.rewards,
        Columns.NEXT_OBS: rows.next_obs,
        Columns.TERMINATEDS: rows.terminated,
    }
    return MultiAgentBatch({DEFAULT_POLICY_ID: SampleBatch(columns)}, env_steps=len(rows))


class OffPolicy(MeshAlgorithm):
    """Rounds of experience and the updates owed for them; experience and episodes in flight are in the checkpoint."""

    local_replay_buffer: ReplayBuffer
    config: OffPolicyConfig

    def _create_local_replay_buffer_if_necessary(self, config: Any) -> None:
        # The widths are known once the environments are: see setup.
        return None

    def setup(self, config: Any) -> None:
        """Build runners and learner, then the buffer for their spaces."""
        super().setup(config)
        observation_space, action_space = self.env_runner_group.get_spaces()[DEFAULT_POLICY_ID]
        self.local_replay_buffer = ReplayBuffer(
            int(self.config.replay_buffer_config["capacity"]),
            observation_space.shape[0],
            action_space.shape[0],
            seed=self.config.seed,
        )
        #: Updates owed for steps taken, less than one after a round.
        self._debt = 0.0

    def training_step(self) -> None:
        """One round: every env runner's fragment, then the updates that it is owed."""
        warming = self.env_steps < self.config.warmup_steps
        with self.metrics.log_time(("timers", "collect")):
            harvest = self._collect(uniform=warming)
        if not harvest:
            return
        for part in harvest:
            self.local_replay_buffer.add(part.transitions)
        steps = sum(len(part.transitions) for part in harvest)
        warm = max(0, self.env_steps + steps - max(self.env_steps, self.config.warmup_steps))
        self._count(steps, [episode for part in harvest for episode in part.episodes])
        self._debt += warm * self.config.updates_per_step
        if (owed := int(self._debt)) > 0:
            self._debt -= owed
            self._update(owed)
            self._publish()

    def _collect(self, uniform: bool) -> list[Collected]:
        return self._from_runners("collect", rounds=self.config.get_rollout_fragment_length(), uniform=uniform)

    def _update(self, count: int) -> None:
        rows = self.local_replay_buffer.sample(count * self.config.total_train_batch_size)
        batches = [batch(part) for part in dealt(rows, count, max(1, self.config.num_learners))]
        given: dict[str, Any] = {"batch": batches[0]} if self.learner_group.is_local else {"batches": batches}
        with self.metrics.log_time(("timers", "learn")):
            results = self.learner_group.update(timesteps={NUM_ENV_STEPS_SAMPLED_LIFETIME: self.env_steps}, **given)
        self._learnt(results)
        self.updates += count

    def reseed(self, seed: int) -> None:
        """MeshAlgorithm's, and other minibatches."""
        super().reseed(seed)
        self.local_replay_buffer.reseed(seed)

    def get_state(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """MeshAlgorithm's state with what rounds depend on: updates owed, episodes in flight, experience."""
        state = super().get_state(*args, **kwargs)
        state["debt"] = self._debt
        state[ROLLOUTS] = self._each_runner(lambda runner: (runner.worker_index, runner.rollout_state()))
        if REPLAY_BUFFER not in (kwargs.get("not_components") or []):
            state[REPLAY_BUFFER] = self.local_replay_buffer.get_state()
        return state

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state.

        Raises:
            ValueError: the state's curriculum is of other stages.
        """
        super().set_state(state)
        if REPLAY_BUFFER in state:
            self.local_replay_buffer.set_state(state[REPLAY_BUFFER])
        if "debt" not in state:
            return
        self._debt = state["debt"]
        rollouts = dict(state[ROLLOUTS])
        self._each_runner(
            lambda runner: runner.worker_index in rollouts and runner.set_rollout_state(rollouts[runner.worker_index])
        )

    def get_checkpointable_components(self) -> list[tuple[str, Any]]:
        """RLlib's components, and the replay buffer, which it forgets."""
        return [*super().get_checkpointable_components(), (REPLAY_BUFFER, self.local_replay_buffer)]
