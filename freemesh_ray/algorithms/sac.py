"""SAC for mesh generation: RLlib's algorithm with a flat replay buffer, a lean learner and a batched env runner.

``SACConfig`` states every number of the paper's table; RLlib's own defaults differ from it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from ray.rllib.algorithms.sac import SAC as RLlibSAC
from ray.rllib.algorithms.sac import SACConfig as RLlibSACConfig
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID, MultiAgentBatch, SampleBatch
from ray.rllib.utils.metrics import ENV_RUNNER_RESULTS, LEARNER_RESULTS, NUM_ENV_STEPS_SAMPLED_LIFETIME

from envs.types import MeshingParameters
from freemesh_ray.algorithms.env_runner import Collected, Episode, TransitionEnvRunner
from freemesh_ray.algorithms.replay_buffer import ReplayBuffer, Transitions
from freemesh_ray.algorithms.sac_learner import SACLearner
from freemesh_ray.algorithms.sac_module import SACModule
from freemesh_ray.curriculum import Curriculum
from freemesh_ray.evaluate import evaluation_episodes, summary
from freemesh_ray.policy import Policy

ROLLOUTS = "rollouts"
REPLAY_BUFFER = "replay_buffer"


class SACConfig(RLlibSACConfig):
    """Hyperparameters of the paper (table "Training hyperparameters"), and what the paper leaves open.

    Besides RLlib's own settings: ``hidden`` (units of each hidden layer), ``updates_per_step`` (gradient steps for each
    env step), ``warmup_steps`` (uniform actions, no updates), ``curriculum`` (a Curriculum, or None to leave the
    environments' task alone).
    """

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class or SAC)
        self.gamma = 0.99
        self.tau = 5e-3
        self.actor_lr = self.critic_lr = self.alpha_lr = 3e-4
        self.initial_alpha = 1.0
        self.target_entropy: str | float = "auto"
        self.train_batch_size_per_learner = 256
        self.replay_buffer_config: dict[str, Any] = {"type": "EpisodeReplayBuffer", "capacity": 1_000_000}
        self.hidden: list[int] = [128, 128, 128]
        self.updates_per_step = 1.0
        self.warmup_steps = 5_000
        self.num_steps_sampled_before_learning_starts = self.warmup_steps
        self.curriculum: Curriculum | None = None
        self.env_runner_cls = TransitionEnvRunner
        self.num_envs_per_env_runner = 16
        self.rollout_fragment_length = 8
        self.gym_env_vectorize_mode = "vector_entry_point"
        self.min_time_s_per_iteration = 0
        self.min_sample_timesteps_per_iteration = 1_000
        self.restart_failed_env_runners = True
        self.delay_between_env_runner_restarts_s = 1.0
        self.torch_skip_nan_gradients = False

    def training(self, **settings: Any) -> SACConfig:
        """RLlib's training settings, and ``hidden``, ``updates_per_step``, ``warmup_steps``, ``curriculum``."""
        for name in ("hidden", "updates_per_step", "warmup_steps", "curriculum"):
            if name in settings:
                setattr(self, name, settings.pop(name))
        super().training(**settings)
        self.num_steps_sampled_before_learning_starts = self.warmup_steps
        return self

    def validate(self) -> None:
        """RLlib's checks, and those of the settings above.

        Raises:
            ValueError: a setting that this algorithm would silently ignore.
        """
        super().validate()
        if self.num_learners > 1:
            raise ValueError(f"num_learners = {self.num_learners}: this learner does not average gradients; use 0 or 1")
        if self.n_step != 1:
            raise ValueError(f"n_step = {self.n_step}: this buffer holds single transitions; use 1")
        if self.updates_per_step <= 0:
            raise ValueError(f"updates_per_step = {self.updates_per_step}: must be above 0")
        if self.warmup_steps < 1:
            raise ValueError(f"warmup_steps = {self.warmup_steps}: must be at least 1")

    def get_default_learner_class(self) -> type[SACLearner]:
        """The lean learner."""
        return SACLearner

    def get_default_rl_module_spec(self) -> RLModuleSpec:
        """The paper's networks."""
        return RLModuleSpec(
            module_class=SACModule,
            model_config={"hidden": list(self.hidden), "initial_alpha": self.initial_alpha},
        )

    @property
    def _model_config_auto_includes(self) -> dict[str, Any]:
        return {}


class SAC(RLlibSAC):
    """Collect from all env runners, store, update, publish weights; curriculum and experience in the checkpoint."""

    local_replay_buffer: ReplayBuffer
    config: SACConfig

    @classmethod
    def get_default_config(cls) -> SACConfig:
        """The paper's hyperparameters."""
        return SACConfig()

    def _create_local_replay_buffer_if_necessary(self, config: Any) -> None:
        # The widths are known once the environments are: see setup.
        return None

    def setup(self, config: Any) -> None:
        """Build runners and learner, then the buffer for their spaces."""
        super().setup(config)
        spaces = self.learner_group._learner.module[DEFAULT_POLICY_ID] if self.learner_group.is_local else None
        observation_space, action_space = (
            (spaces.observation_space, spaces.action_space) if spaces else self.spaces[DEFAULT_POLICY_ID]
        )
        self.local_replay_buffer = ReplayBuffer(
            int(self.config.replay_buffer_config["capacity"]),
            observation_space.shape[0],
            action_space.shape[0],
            seed=self.config.seed,
        )
        self.curriculum = self.config.curriculum
        self.env_steps = 0
        self.updates = 0
        #: Updates owed for steps taken, less than one after a round.
        self._debt = 0.0
        #: Episodes that ended since the caller last took them.
        self.finished: list[Episode] = []

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
        episodes = [episode for part in harvest for episode in part.episodes]
        warm = max(0, self.env_steps + steps - max(self.env_steps, self.config.warmup_steps))
        self.env_steps += steps
        self._log_round(steps, episodes)
        if self.curriculum is not None:
            self.curriculum = self.curriculum.after(steps, [(e.domain, e.completed) for e in episodes])
        self._debt += warm * self.config.updates_per_step
        if (owed := int(self._debt)) > 0:
            self._debt -= owed
            self._update(owed)

    def _collect(self, uniform: bool) -> list[Collected]:
        group = self.env_runner_group
        request = {
            "rounds": self.config.get_rollout_fragment_length(),
            "uniform": uniform,
            "task": None if self.curriculum is None else self.curriculum.task(),
        }
        if group.num_remote_env_runners() == 0:
            return [self.env_runner.collect(**request)]
        return group.foreach_env_runner("collect", kwargs=request, local_env_runner=False)

    def _update(self, count: int) -> None:
        rows: Transitions = self.local_replay_buffer.sample(count * self.config.train_batch_size_per_learner)
        batch = SampleBatch(
            {
                Columns.OBS: rows.obs,
                Columns.ACTIONS: rows.actions,
                Columns.REWARDS: rows.rewards,
                Columns.NEXT_OBS: rows.next_obs,
                Columns.TERMINATEDS: rows.terminated,
            }
        )
        with self.metrics.log_time(("timers", "learn")):
            results = self.learner_group.update(
                batch=MultiAgentBatch({DEFAULT_POLICY_ID: batch}, env_steps=len(rows)),
                timesteps={NUM_ENV_STEPS_SAMPLED_LIFETIME: self.env_steps},
            )
        self.metrics.aggregate(results, key=LEARNER_RESULTS)
        self.updates += count
        with self.metrics.log_time(("timers", "publish")):
            self.env_runner_group.sync_weights(
                from_worker_or_learner_group=self.learner_group, inference_only=True, timeout_seconds=None
            )

    def _log_round(self, steps: int, episodes: list[Episode]) -> None:
        self.finished.extend(episodes)
        key = ENV_RUNNER_RESULTS
        self.metrics.log_value((key, NUM_ENV_STEPS_SAMPLED_LIFETIME), steps, reduce="lifetime_sum")
        self.metrics.log_value((key, "num_episodes_lifetime"), len(episodes), reduce="lifetime_sum")
        if self.curriculum is not None:
            self.metrics.log_value((key, "stage"), self.curriculum.stage, window=1)
        for episode in episodes:
            for name, value in (
                ("episode_return_mean", episode.episode_return),
                ("episode_len_mean", episode.length),
                ("completion_rate", float(episode.completed)),
                ("elements_mean", episode.elements),
                ("element_quality_mean", episode.mean_eta),
            ):
                self.metrics.log_value((key, name), value, window=self.config.metrics_num_episodes_for_smoothing)

    def evaluate(self, parallel_train_future: Any = None) -> dict[str, Any]:
        """The paper's evaluation: ``evaluation_duration`` episodes of each kind on every domain, and one on
        each of ``HELD_OUT_DOMAINS`` unseen ones where a supply draws them without end.

        In this process: the episodes of a domain run side by side in compiled code, faster than they could be sent.

        Returns:
            ``{"deterministic": {domain: figures}, "stochastic": ...}``; figures: evaluate.summary.
        """
        options = dict(self.config.env_config)
        domains = options.pop("domain")
        layers = [(np.asarray(weight), np.asarray(bias)) for weight, bias in self.actor_weights()]
        policy = Policy(layers, MeshingParameters(**options))
        episodes, seed = int(self.config.evaluation_duration), self.config.seed or 0
        return {
            kind: {
                entry.name: summary(evaluation_episodes(policy, entry, episodes, stochastic=stochastic, seed=seed))
                for entry in domains
            }
            for kind, stochastic in (("deterministic", False), ("stochastic", True))
        }

    def actor_weights(self) -> list[tuple[Any, Any]]:
        """(weight (inputs, outputs), bias (outputs,)) of each layer of the actor, float32 arrays."""
        return self._weights("actor", inference_only=True)

    def critic_weights(self) -> list[tuple[Any, Any]]:
        """(weight (2, inputs, outputs), bias (2, outputs)) of each layer of the twin critics, float32 arrays."""
        return [(weight, bias[:, 0]) for weight, bias in self._weights("critic", inference_only=False)]

    def _weights(self, network: str, *, inference_only: bool) -> list[tuple[Any, Any]]:
        state = self.learner_group.get_state(components="learner/rl_module", inference_only=inference_only)
        module = state["learner"]["rl_module"][DEFAULT_POLICY_ID]
        layers = sum(name.startswith(f"{network}.weights") for name in module)
        return [(module[f"{network}.weights.{i}"], module[f"{network}.biases.{i}"]) for i in range(layers)]

    def get_state(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """RLlib's state, with what it leaves out: counters, curriculum, episodes in flight, experience."""
        state = super().get_state(*args, **kwargs)
        state |= {
            "env_steps": self.env_steps,
            "updates": self.updates,
            "debt": self._debt,
            "finished": list(self.finished),
            "curriculum": None if self.curriculum is None else self.curriculum.state(),
            ROLLOUTS: self.env_runner_group.foreach_env_runner(
                lambda runner: (runner.worker_index, runner.rollout_state()),
                local_env_runner=self.env_runner_group.num_remote_env_runners() == 0,
            ),
        }
        not_components = kwargs.get("not_components") or []
        if REPLAY_BUFFER not in not_components:
            state[REPLAY_BUFFER] = self.local_replay_buffer.get_state()
        return state

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state.

        Raises:
            ValueError: the state's curriculum is of other stages.
        """
        curriculum = self.curriculum
        if curriculum is not None and state.get("curriculum") is not None:
            curriculum = curriculum.restored(state["curriculum"])
        super().set_state(state)
        if REPLAY_BUFFER in state:
            self.local_replay_buffer.set_state(state[REPLAY_BUFFER])
        if "env_steps" not in state:
            return
        self.env_steps, self.updates, self._debt = state["env_steps"], state["updates"], state["debt"]
        self.finished = list(state["finished"])
        self.curriculum = curriculum
        rollouts = dict(state[ROLLOUTS])
        self.env_runner_group.foreach_env_runner(
            lambda runner: runner.worker_index in rollouts and runner.set_rollout_state(rollouts[runner.worker_index]),
            local_env_runner=self.env_runner_group.num_remote_env_runners() == 0,
        )

    def get_checkpointable_components(self) -> list[tuple[str, Any]]:
        """RLlib's components, and the replay buffer, which it forgets."""
        return [*super().get_checkpointable_components(), (REPLAY_BUFFER, self.local_replay_buffer)]
