"""Learning from a replay buffer: collect from all env runners, store, take the gradient steps due, publish weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID, MultiAgentBatch, SampleBatch
from ray.rllib.utils.metrics import ENV_RUNNER_RESULTS, NUM_ENV_STEPS_SAMPLED_LIFETIME

from freemesh_ray.algorithms import bfloat16
from freemesh_ray.algorithms.actor_critic_module import ActorCriticModule
from freemesh_ray.algorithms.env_runner import Collected, Episode
from freemesh_ray.algorithms.mesh_algorithm import MeshAlgorithm, MeshConfig
from freemesh_ray.algorithms.off_policy_learner import STEPS, OffPolicyLearner
from freemesh_ray.algorithms.replay_buffer import ReplayBuffer, Transitions
from freemesh_ray.config import ALGORITHMS, SCHEMA, Field, Hyperparameter, check

ROLLOUTS = "rollouts"
REPLAY_BUFFER = "replay_buffer"


class OffPolicyConfig(MeshConfig):
    """What the algorithms with a replay buffer have in common; the numbers are those of the paper's table.

    Besides MeshConfig's settings: ``replay_buffer_config``, ``tau``, ``actor_lr`` and ``critic_lr`` as RLlib's SAC has
    them, ``updates_per_step`` (gradient steps for each env step), ``warmup_steps`` (uniform actions, no updates),
    ``precision`` (of the factors of the networks' products: float32 or bfloat16), ``n_step`` (steps of a return),
    ``normalise_observations``, ``layer_norm`` (of the critics), ``overlap`` (remote env runners collect while the
    learner updates), and those of the algorithm's section in a configuration, with their defaults.

    A subclass says its name and its learner; what else it may change is below.
    """

    OWN = (
        *MeshConfig.OWN, "replay_buffer_config", "tau", "actor_lr", "critic_lr", "updates_per_step", "warmup_steps",
        "precision", "n_step", "normalise_observations", "layer_norm", "overlap",
    )  # fmt: skip
    #: In `ALGORITHMS`, where its settings are.
    NAME: str
    LEARNER: type[OffPolicyLearner]
    MODULE: type[ActorCriticModule] = ActorCriticModule
    CRITICS = 2

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class or OffPolicy)
        self.tau = 5e-3
        self.actor_lr = self.critic_lr = 3e-4
        self.train_batch_size_per_learner = 256
        self.replay_buffer_config: dict[str, Any] = {"type": "EpisodeReplayBuffer", "capacity": 1_000_000}
        self.updates_per_step = 1.0
        self.warmup_steps = 5_000
        self.precision = "float32"
        self.n_step = 1
        self.normalise_observations = False
        self.layer_norm = False
        self.overlap = True
        self.rollout_fragment_length = 8
        for name, setting in self._section().items():
            setattr(self, name, setting.default)

    def _section(self) -> Mapping[str, Hyperparameter]:
        """The algorithm's own settings."""
        return ALGORITHMS[self.NAME].settings

    def training(self, **settings: Any) -> Self:
        """MeshConfig's, and the algorithm's own settings; this configuration."""
        for name in self._section().keys() & settings.keys():
            setattr(self, name, settings.pop(name))
        return super().training(**settings)

    def configure(self, config: Mapping[str, Any]) -> Self:
        """Take over how a configuration tree says to learn; this configuration."""
        learner = config["learner"]
        return self.env_runners(rollout_fragment_length=config["runners"]["fragment"]).training(
            tau=learner["tau"],
            actor_lr=learner["learning_rate"],
            critic_lr=learner["learning_rate"],
            train_batch_size_per_learner=learner["batch_size"] // max(1, learner["count"]),
            replay_buffer_config={"type": "EpisodeReplayBuffer", "capacity": learner["buffer_size"]},
            updates_per_step=learner["updates_per_step"],
            warmup_steps=learner["warmup_steps"],
            precision=learner["precision"],
            n_step=learner["n_step"],
            normalise_observations=learner["normalise_observations"],
            layer_norm=learner["layer_norm"],
            overlap=config["runners"]["overlap"],
            **config[self.NAME],
        )

    def validate(self) -> None:
        """RLlib's checks, and that the settings above are in their ranges.

        Raises:
            ConfigError: one is not.
        """
        super().validate()
        ranges: dict[str, Field] = {
            name: SCHEMA[f"learner.{name}"] for name in ("updates_per_step", "warmup_steps", "precision", "n_step")
        }
        for name, accepts in (ranges | {name: own.accepts for name, own in self._section().items()}).items():
            check(getattr(self, name), accepts, type(self).__name__, name)

    def get_default_learner_class(self) -> type[OffPolicyLearner]:
        """The algorithm's."""
        return self.LEARNER

    def get_default_rl_module_spec(self) -> RLModuleSpec:
        """The algorithm's networks, which know its settings."""
        own = {name: getattr(self, name) for name in self._section()}
        networks = {
            "hidden": list(self.hidden),
            "critics": self.CRITICS,
            "normalise": self.normalise_observations,
            "layer_norm": self.layer_norm,
        }
        return RLModuleSpec(module_class=self.MODULE, model_config=networks | own)


def learner_shares(rows: Transitions, minibatches: int, learners: int) -> list[Transitions]:
    """Consecutive minibatches, each cut into one equal share for each learner: the i-th of all, for each learner i."""

    def share(column: np.ndarray, i: int) -> np.ndarray:
        return column.reshape(minibatches, learners, -1, *column.shape[1:])[:, i].reshape(-1, *column.shape[1:])

    return [Transitions(*(share(column, i) for column in rows)) for i in range(learners)]


def batch(rows: Transitions) -> MultiAgentBatch:
    """Transitions as a learner takes them."""
    columns = {
        Columns.OBS: rows.obs,
        Columns.ACTIONS: rows.actions,
        Columns.REWARDS: rows.rewards,
        Columns.NEXT_OBS: rows.next_obs,
        Columns.TERMINATEDS: rows.terminated,
        STEPS: rows.steps,
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
        if self.config.precision == "bfloat16" and self.config.num_gpus_per_learner == 0 and not bfloat16.native():
            self.incidents.append(
                "learner.precision: this processor has no instructions for bfloat16 numbers and is slow at them: "
                "auto or float32 is faster here"
            )
        #: Updates owed for steps taken, less than one after a round.
        self._debt = 0.0
        #: Fragments of the next round, where a checkpoint had to wait for them.
        self._ahead: list[Collected] = []
        #: Updates made when they were asked for.
        self._asked_at = 0

    def training_step(self) -> None:
        """One round: every env runner's fragment, then the updates that it is owed.

        Where remote env runners overlap with learning, they collect the next round's fragments meanwhile.
        """
        overlaps = self.config.overlap and self._samples_remotely
        with self.metrics.log_time(("timers", "collect")):
            collected = self._collect()
        if not collected:
            return
        for one in collected:
            self.local_replay_buffer.add(one.transitions)
        steps = sum(len(one.transitions) for one in collected)
        warm = max(0, self.env_steps + steps - max(self.env_steps, self.config.warmup_steps))
        self._count(steps, [episode for one in collected for episode in one.episodes])
        self.metrics.log_value((ENV_RUNNER_RESULTS, "weights_age"), self.updates - self._asked_at, window=1)
        if overlaps:
            self._ask()
        self._debt += warm * self.config.updates_per_step
        if (owed := int(self._debt)) > 0:
            self._debt -= owed
            self._update(owed)
            self._publish(wait=not overlaps)

    def _collect(self) -> list[Collected]:
        """What the env runners have collected, by now or for this call."""
        if self._ahead:
            taken, self._ahead = self._ahead, []
            return taken
        self._ask()
        return self._from_runners()

    def _ask(self) -> None:
        """Let every env runner that does nothing collect a fragment."""
        if not self._calls:
            self._asked_at = self.updates
        warming = self.env_steps < self.config.warmup_steps
        self._ask_runners("collect", rounds=self.config.get_rollout_fragment_length(), uniform=warming)

    def _update(self, count: int) -> None:
        rows = self.local_replay_buffer.sample(count * self.config.total_train_batch_size)
        batches = [batch(share) for share in learner_shares(rows, count, max(1, self.config.num_learners))]
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
        if self._calls:
            self._ahead = self._answers()
        state["debt"] = self._debt
        state["ahead"] = [(tuple(one.transitions), [tuple(episode) for episode in one.episodes]) for one in self._ahead]
        state["asked_at"] = self._asked_at
        state[ROLLOUTS] = self._each_runner(lambda runner: (runner.worker_index, runner.rollout_state()))
        if REPLAY_BUFFER not in (kwargs.get("not_components") or []):
            state[REPLAY_BUFFER] = self.local_replay_buffer.get_state()
        return state

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state.

        Raises:
            ValueError: the state's curriculum is of other stages.
        """
        if self._calls:  # of what it was before
            self._answers()
        super().set_state(state)
        if REPLAY_BUFFER in state:
            self.local_replay_buffer.set_state(state[REPLAY_BUFFER])
        if "debt" not in state:
            return
        self._debt = state["debt"]
        self._ahead = [
            Collected(Transitions(*rows), [Episode(*episode) for episode in ended]) for rows, ended in state["ahead"]
        ]
        self._asked_at = state["asked_at"]
        rollouts = dict(state[ROLLOUTS])
        self._each_runner(
            lambda runner: runner.worker_index in rollouts and runner.set_rollout_state(rollouts[runner.worker_index])
        )

    def get_checkpointable_components(self) -> list[tuple[str, Any]]:
        """RLlib's components, and the replay buffer, which it forgets."""
        return [*super().get_checkpointable_components(), (REPLAY_BUFFER, self.local_replay_buffer)]
