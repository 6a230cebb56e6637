"""The base of every algorithm, what the training loop needs: counters, curriculum, evaluation, weights."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Self

import numpy as np
from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.core import COMPONENT_LEARNER, COMPONENT_RL_MODULE
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID
from ray.rllib.utils.metrics import (
    ENV_RUNNER_RESULTS,
    LEARNER_RESULTS,
    NUM_ENV_STEPS_SAMPLED_LIFETIME,
    WEIGHTS_SEQ_NO,
)

from envs.errors import PluginError
from envs.plug_ins.environment_parts import NONE
from freemesh_ray.algorithms.awake import awake
from freemesh_ray.algorithms.curriculum import Curriculum
from freemesh_ray.algorithms.cut import Cut
from freemesh_ray.algorithms.env_runner import Episode, Failure, TransitionEnvRunner
from freemesh_ray.algorithms.normaliser import folded
from freemesh_ray.algorithms.process_group import met_by_file
from freemesh_ray.algorithms.runner_calls import RunnerCalls
from freemesh_ray.config import ALGORITHMS
from freemesh_ray.config import Algorithm as AlgorithmEntry
from freemesh_ray.policies.evaluation import MODES, evaluate, user_metric
from freemesh_ray.policies.policy import Policy

#: Seconds between two looks whether an env runner that died is back: each look holds up the training.
PROBE_SECONDS = 3.0
#: Seconds to wait where there is no env runner to ask.
PAUSE_SECONDS = 0.2
#: Failures of one env runner, in a row, that are taken for chance.
MOST_FAILURES = 5


class EnvRunnerError(RuntimeError):
    """Env runners that fail again and again, or none of which answers; one line with the last reason."""


class DivergedError(RuntimeError):
    """A loss is not finite: training has to go back to the last checkpoint."""


class MeshConfig(AlgorithmConfig):
    """How environments are run, whatever learns from them.

    Besides RLlib's own settings: ``hidden`` (units of each hidden layer), ``curriculum`` (a Curriculum, or None to
    leave the environments' task alone), ``runner_timeout`` (seconds without an answer after which an env runner is
    replaced), ``evaluation_metrics`` (names of metrics of a user's own), ``plugged`` (name and entry of an algorithm of
    a user's own, which every process that the configuration is sent to then knows).
    """

    #: Settings of ``training`` that RLlib does not know.
    OWN: tuple[str, ...] = ("hidden", "curriculum", "runner_timeout", "evaluation_metrics", "plugged")

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class)
        self.hidden: list[int] = [128, 128, 128]
        self.curriculum: Curriculum | None = None
        self.runner_timeout = 300.0
        self.evaluation_metrics: tuple[str, ...] = ()
        self.plugged: tuple[str, AlgorithmEntry] | None = None
        self.gamma = 0.99
        self.env_runner_cls = TransitionEnvRunner
        self.num_env_runners = 0
        self.num_envs_per_env_runner = 16
        self.gym_env_vectorize_mode = "vector_entry_point"
        self.min_time_s_per_iteration = 0
        self.min_sample_timesteps_per_iteration = 1_000
        self.restart_failed_env_runners = True
        self.delay_between_env_runner_restarts_s = 1.0
        self.env_runner_health_probe_timeout_s = 1.0
        # RLlib leaves new weights out while a runner has not answered its last message: a restored training then
        # began with other networks than its own, wherever a runner was slow. They arrive in the order they were sent.
        self.max_requests_in_flight_per_env_runner = 1_000
        self.torch_skip_nan_gradients = False

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Arrive in a process."""
        self.__dict__.update(state)
        if self.plugged is not None:
            ALGORITHMS.setdefault(*self.plugged)

    def configure(self, config: Mapping[str, Any]) -> Self:
        """Take over how a configuration tree (see ``config.load``) says to learn; this configuration."""
        raise NotImplementedError

    def training(self, **settings: Any) -> Self:
        """RLlib's training settings, and those of ``OWN``; this configuration."""
        for name in self.OWN:
            if name in settings:
                setattr(self, name, settings.pop(name))
        return super().training(**settings)

    def build_learner_group(self, **given: Any) -> Any:
        """RLlib's, whose learners do not listen to the network."""
        with met_by_file():
            return super().build_learner_group(**given)

    @property
    def _model_config_auto_includes(self) -> dict[str, Any]:
        return {}


class MeshAlgorithm(Algorithm):
    """An algorithm as ``training.Algorithm`` has it; a learner beside it says how a round is taken."""

    config: MeshConfig

    @classmethod
    def get_default_config(cls) -> MeshConfig:
        """What every configuration given is an instance of: RLlib then completes none of them."""
        return MeshConfig()

    def setup(self, config: Any) -> None:
        """Build runners and learner; nothing is taken yet."""
        super().setup(config)
        self.curriculum = self.config.curriculum
        self.env_steps = 0
        self.updates = 0
        #: Episodes that ended since the caller last took them.
        self.finished: list[Episode] = []
        #: Failures recovered from since the caller last took them, a line each.
        self.incidents: list[str] = []
        self._failures: Counter[int] = Counter()
        #: To remote env runners; to the one in this process what it is asked for next.
        self._calls = RunnerCalls(self.env_runner_group._worker_manager, self.config.runner_timeout)
        self._wanted: tuple[str, dict[str, Any]] | None = None
        #: What a plug-in did, in an env runner.
        self._fault: str | None = None
        #: Since when no env runner answers; None while one does.
        self._silent: float | None = None
        self._probed = time.monotonic()
        #: Asked before every round, and for every domain of an evaluation; yes: leave with `Cut`.
        self.hurried: Callable[[], bool] = lambda: False

    def _setup_logdir(self) -> None:
        """Make no folder but Tune's: RLlib writes nothing here into the one that it makes in ~/ray_results."""
        if self._storage:
            super()._setup_logdir()

    @property
    def _samples_remotely(self) -> bool:
        """Whether env runners are processes of their own."""
        return bool(self.env_runner_group.num_remote_env_runners())

    def _ask_runners(self, method: str, **request: Any) -> None:
        """Call ``method`` of the env runners, with the curriculum's task as ``task``, for `_from_runners`.

        Remote ones begin at once; the one in this process when its answer is wanted.
        """
        request["task"] = None if self.curriculum is None else self.curriculum.task()
        if self._samples_remotely:
            self._calls.ask(method, request)
        else:
            self._wanted = method, request

    def _from_runners(self) -> list[Any]:
        """What the env runners answer to `_ask_runners`.

        One that dies, raises or does not answer in time is missing from the answers; it is started anew, or begins new
        episodes, while the others go on.

        Raises:
            EnvRunnerError: one raises again and again, or for ``runner_timeout`` none has answered.
            PluginError: a plug-in failed in one.
            Cut: it is hurried.
        """
        self._leave_if_hurried()
        answers = self._answers()
        if self._fault is not None:
            fault, self._fault = self._fault, None
            raise PluginError(fault)
        return answers

    def _answers(self) -> list[Any]:
        """`_from_runners`, hurried or not; it keeps for that what a plug-in did, so that a checkpoint can be saved."""
        if self._wanted is not None:
            (method, request), self._wanted = self._wanted, None
            found = {0: getattr(self.env_runner, method)(**request)}
        elif self._calls:
            found = self._calls.answers()
        else:
            time.sleep(PAUSE_SECONDS)
            found = {}
        answers = []
        for runner, answer in found.items():
            if isinstance(answer, Failure):
                if answer.plugged:
                    self._fault = answer.reason
                else:
                    self._failed(runner, answer.reason)
            else:
                self._failures.pop(runner, None)
                answers.append(answer)
        if answers:
            self._silent = None
        elif self._silent is None:  # what was asked may have taken its time: a replacement gets as long again
            self._silent = awake()
        elif awake() - self._silent > self.config.runner_timeout:
            raise EnvRunnerError(f"no env runner has answered for {self.config.runner_timeout:.0f} s")
        return answers

    def _leave_if_hurried(self) -> None:
        if self.hurried():
            raise Cut

    def _failed(self, runner: int, reason: str) -> None:
        """Note a failure.

        Raises:
            EnvRunnerError: it is one too many.
        """
        self._failures[runner] += 1
        self.incidents.append(f"env runner {runner} failed ({reason}); it begins anew")
        if self._failures[runner] > MOST_FAILURES:
            raise EnvRunnerError(f"env runner {runner} failed {MOST_FAILURES + 1} times in a row: {reason}")

    def restore_env_runners(self, env_runner_group: Any) -> list[int]:
        """RLlib's, but only every few seconds: to look whether a dead runner is back takes as long as it is not."""
        if time.monotonic() - self._probed < PROBE_SECONDS:
            return []
        restored = super().restore_env_runners(env_runner_group)
        self._probed = time.monotonic()
        return restored

    def _each_runner(self, function: Callable[[Any], Any]) -> list[Any]:
        """``function`` of every env runner that answers in time."""
        group = self.env_runner_group
        return group.foreach_env_runner(
            function,
            local_env_runner=group.num_remote_env_runners() == 0,
            timeout_seconds=self.config.runner_timeout,
        )

    def reseed(self, seed: int) -> None:
        """Draw other random numbers from here on than a training that went the same way so far."""
        self._each_runner(lambda runner: runner.reseed([seed, runner.worker_index or 0]))

    def _count(self, steps: int, episodes: list[Episode]) -> None:
        """Log a round of ``steps`` env steps and the episodes that ended in it, and go on in the curriculum."""
        self.env_steps += steps
        self.finished.extend(episodes)
        key = ENV_RUNNER_RESULTS
        self.metrics.log_value((key, NUM_ENV_STEPS_SAMPLED_LIFETIME), steps, reduce="lifetime_sum")
        self.metrics.log_value((key, "num_episodes_lifetime"), len(episodes), reduce="lifetime_sum")
        if self.curriculum is not None:
            self.metrics.log_value((key, "stage"), self.curriculum.stage, window=1)
            self.curriculum = self.curriculum.after(steps, [(e.domain, e.completed) for e in episodes])
        for episode in episodes:
            for name, value in (
                ("episode_return_mean", episode.episode_return),
                ("episode_len_mean", episode.length),
                ("completion_rate", float(episode.completed)),
                ("elements_mean", episode.elements),
                ("element_quality_mean", episode.mean_eta),
            ):
                self.metrics.log_value((key, name), value, window=self.config.metrics_num_episodes_for_smoothing)

    def _learnt(self, results: list[Any]) -> None:
        """Log what the learners tell of an update.

        Raises:
            DivergedError: a loss is not finite; the env runners have not got the networks yet.
        """
        self.metrics.aggregate(results, key=LEARNER_RESULTS)
        for result in results:
            for name, figure in result[DEFAULT_POLICY_ID].items():
                if name.endswith("loss") and not math.isfinite(loss := float(figure.peek())):
                    raise DivergedError(f"{name} is {loss} at {self.env_steps:,} steps")

    def _publish(self, *, wait: bool = True) -> None:
        """Send the actor to the env runners, whose later calls then act by it.

        Args:
            wait: until they have it.
        """
        with self.metrics.log_time(("timers", "publish")):
            if not self._samples_remotely:  # not by way of Ray's object store
                learnt = [f"{COMPONENT_LEARNER}/{COMPONENT_RL_MODULE}"]
                state = self.learner_group.get_state(components=learnt, inference_only=True)[COMPONENT_LEARNER]
                self.env_runner.set_state({key: state[key] for key in (COMPONENT_RL_MODULE, WEIGHTS_SEQ_NO)})
                return
            self.env_runner_group.sync_weights(
                from_worker_or_learner_group=self.learner_group,
                inference_only=True,
                timeout_seconds=self.config.runner_timeout if wait else 0.0,
            )

    def evaluate(self, parallel_train_future: Any = None) -> dict[str, Any]:
        """The paper's evaluation: ``evaluation_duration`` episodes of each mode on every domain, and one on
        each of ``HELD_OUT_DOMAINS`` unseen ones where a supply draws them without end.

        In this process: the episodes of a domain run side by side in compiled code, faster than they could be sent.

        Returns:
            ``{"deterministic": {domain: figures}, "stochastic": ...}``; figures: evaluation.FIGURES, and those of the
            user's metrics.

        Raises:
            Cut: it is hurried.
            PluginError: a plug-in failed.
        """
        domains, parameters = (self.config.env_config[key] for key in ("domain", "parameters"))
        layers = [(np.asarray(weight), np.asarray(bias)) for weight, bias in self.actor_weights()]
        policy = Policy(layers, parameters, plug_ins=self.config.env_config.get("plug_ins", NONE))
        metrics = [user_metric(spec) for spec in self.config.evaluation_metrics]
        episodes, seed = int(self.config.evaluation_duration), self.config.seed or 0

        by_domain = {}
        for domain in domains:
            self._leave_if_hurried()
            by_domain[domain.name] = evaluate(policy, domain, episodes, seed, metrics)
        return {mode: {name: figures[mode] for name, figures in by_domain.items()} for mode in MODES}

    def actor_weights(self) -> list[tuple[Any, Any]]:
        """(weight (inputs, outputs), bias (outputs,)) of each layer of the actor as ``Policy`` takes it, float32."""
        return self._weights("actor", inference_only=True)

    def critic_weights(self) -> list[tuple[Any, Any]]:
        """(weight (critics, inputs, outputs), bias (critics, outputs)) of each layer of the action-value critics,
        float32; empty where there are none of plain layers.
        """
        return self._weights("critic", inference_only=False)

    def _weights(self, network: str, *, inference_only: bool) -> list[tuple[Any, Any]]:
        state = self.learner_group.get_state(components="learner/rl_module", inference_only=inference_only)
        module = state["learner"]["rl_module"][DEFAULT_POLICY_ID]
        layers = self._layers(module, network)
        if "normaliser.mean" in module and layers:
            return folded(layers, module["normaliser.mean"], module["normaliser.variance"])
        return layers

    def _layers(self, module: Mapping[str, Any], network: str) -> list[tuple[Any, Any]]:
        """A network's layers, as those of a plain one, from the state of its module."""
        if any(name.startswith(f"{network}.layer_norms") for name in module):
            return []
        count = sum(name.startswith(f"{network}.weights") for name in module)
        weights, biases = ([module[f"{network}.{part}.{i}"] for i in range(count)] for part in ("weights", "biases"))
        # A stack's biases are (k, 1, outputs).
        return [(w, b.reshape(*w.shape[:-2], -1)) for w, b in zip(weights, biases, strict=True)]

    def get_state(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """RLlib's state, with what it leaves out: counters and curriculum."""
        return super().get_state(*args, **kwargs) | {
            "env_steps": self.env_steps,
            "updates": self.updates,
            "finished": list(self.finished),
            "curriculum": None if self.curriculum is None else self.curriculum.state(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state.

        Raises:
            ValueError: the state's curriculum is of other stages.
        """
        curriculum = self.curriculum
        if curriculum is not None and state.get("curriculum") is not None:
            curriculum = curriculum.restored(state["curriculum"])
        super().set_state(state)
        if "env_steps" in state:
            self.env_steps, self.updates = state["env_steps"], state["updates"]
            self.finished = [Episode(*episode) for episode in state["finished"]]
            self.curriculum = curriculum
