"""The rollout worker: steps a batch of environments and returns flat transitions, not episode objects.

``collect`` is what learning from a replay buffer uses, ``rollout`` what needs RLlib's episodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
from ray.rllib.env.single_agent_episode import SingleAgentEpisode

from envs.errors import PluginError
from freemesh_ray.algorithms.alignment import aligned
from freemesh_ray.algorithms.n_step import NStepReturns
from freemesh_ray.algorithms.replay_buffer import Transitions, concatenate


class Episode(NamedTuple):
    """What is kept of an episode that ended.

    Attributes:
        domain: what its domain was drawn as, a stage of the curriculum; empty for environments that have none.
        length: env steps.
        episode_return: undiscounted sum of rewards.
        completed: whether the mesh was finished (for other environments: whether the episode terminated).
        elements: elements cut.
        mean_eta: their mean quality, [0, 1].
    """

    domain: str
    length: int
    episode_return: float
    completed: bool
    elements: int
    mean_eta: float

    @classmethod
    def of(cls, info: Mapping[str, Any], terminated: bool, length: int, episode_return: float) -> Episode:
        """The episode whose last step told ``info``."""
        return cls(
            domain=str(info.get("task", "")),
            length=length,
            episode_return=episode_return,
            completed=bool(info.get("completed", terminated)),
            elements=int(info.get("elements", 0)),
            mean_eta=float(info.get("mean_eta", 0.0)),
        )


class Collected(NamedTuple):
    """What ``collect`` returns: transitions in the order they happened, and the episodes that ended."""

    transitions: Transitions
    episodes: list[Episode]


class Rollout(NamedTuple):
    """What ``rollout`` returns: RLlib's episodes or pieces of them, and the episodes that ended."""

    episodes: list[SingleAgentEpisode]
    ended: list[Episode]


class Failure(NamedTuple):
    """An environment that raised.

    Attributes:
        reason: the exception's kind and the first line of what it says; all that a `PluginError` says.
        plugged: whether a plug-in failed, which is the user's to mend.
    """

    reason: str
    plugged: bool = False

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """That of an exception."""
        if isinstance(error, PluginError):
            return cls(str(error), plugged=True)
        first = str(error).strip().splitlines()[:1]
        return cls(": ".join([type(error).__name__, *first])[:200])


class TransitionEnvRunner(SingleAgentEnvRunner):
    """A SingleAgentEnvRunner with a batched ``collect``."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        torch.set_num_threads(1)
        seed = self.config.seed
        self._random = np.random.default_rng(None if seed is None else [seed, self.worker_index or 0])
        self._obs: np.ndarray | None = None
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        self._returns = np.zeros(self.num_envs)
        self._lengths = np.zeros(self.num_envs, dtype=np.int64)
        #: Length and return so far of the episodes that ``rollout`` has begun.
        self._begun: dict[str, tuple[int, float]] = {}
        #: Steps whose returns are not yet known; None where each is known at once.
        self._n_step = self._n_step_returns() if getattr(self.config, "n_step", 1) > 1 else None

    def collect(
        self, rounds: int, *, uniform: bool = False, task: Mapping[str, float] | None = None
    ) -> Collected | Failure:
        """Take ``rounds`` steps in every environment.

        Args:
            rounds: steps of each environment.
            uniform: draw actions uniformly from the action space (the warm-up) in place of the policy.
            task: which domains new episodes are drawn from, with weights; None leaves it as it is. Sent with every
                call, so that a worker that was started anew needs no second message.

        Returns:
            Transitions and episodes; a Failure where an environment raised, after which the next call begins new
            episodes. To let it out would end this process: RLlib trusts no runner that raised.
        """
        try:
            return self._collect(rounds, uniform, task)
        except Exception as error:
            self._obs = None  # the environments may be in any state
            return Failure.of(error)

    def _collect(self, rounds: int, uniform: bool, task: Mapping[str, float] | None) -> Collected:
        env = self.env.unwrapped
        if task is not None:
            env.task.set(task)
        if self._obs is None:
            self._begin(env)
        steps: list[Transitions] = []
        episodes: list[Episode] = []
        for _ in range(rounds):
            obs = self._obs
            assert obs is not None
            actions = self._uniform_actions(env) if uniform else self._policy_actions(obs, env)
            next_obs, rewards, terminated, truncated, infos = env.step(actions)
            # The step after an end only resets (NEXT_STEP): it is no transition.
            live = ~self._ended
            step = Transitions(
                obs[live], actions[live], rewards[live].astype(np.float32),
                next_obs[live], terminated[live].astype(np.float32), np.ones(live.sum(), dtype=np.float32),
            )  # fmt: skip
            steps.append(step if self._n_step is None else self._n_step.add(live, step, terminated | truncated))
            self._returns[live] += rewards[live]
            self._lengths[live] += 1
            self._ended = terminated | truncated
            for i in np.flatnonzero(self._ended):
                info = {key: infos[key][i] for key in ("task", "completed", "elements", "mean_eta") if key in infos}
                length, episode_return = int(self._lengths[i]), float(self._returns[i])
                episodes.append(Episode.of(info, bool(terminated[i]), length, episode_return))
                self._returns[i], self._lengths[i] = 0.0, 0
            self._obs = next_obs
        # An inherited sample() would find the environments in mid-episode.
        self._needs_initial_reset = True
        return Collected(concatenate(steps), episodes)

    def rollout(self, steps: int, *, task: Mapping[str, float] | None = None) -> Rollout | Failure:
        """RLlib's own sampling of at least ``steps`` steps, over all environments together.

        Args:
            steps: env steps.
            task: as in ``collect``.

        Returns:
            As ``collect``.
        """
        if task is not None:
            self.env.unwrapped.task.set(task)
        try:
            episodes = self.sample(num_timesteps=steps)
        except Exception as error:
            self._needs_initial_reset = True
            self._begun.clear()
            return Failure.of(error)
        self.get_metrics()  # RLlib keeps every episode until it is asked for them
        ended: list[Episode] = []
        for episode in episodes:
            length, episode_return = self._begun.pop(episode.id_, (0, 0.0))
            length, episode_return = length + len(episode), episode_return + float(episode.get_return())
            if episode.is_done:
                info = episode.get_infos(-1)
                ended.append(Episode.of(info, episode.is_terminated, length, episode_return))
            else:
                self._begun[episode.id_] = length, episode_return
        return Rollout(episodes, ended)

    def sample(self, **kwargs: Any) -> Any:
        """RLlib's own sampling, in episodes; ``collect`` then begins afresh."""
        self._obs = None
        return super().sample(**kwargs)

    def reseed(self, seed: list[int]) -> None:
        """Draw other random numbers from here on, and begin new episodes."""
        self._random = np.random.default_rng(seed)
        self._obs = None

    def rollout_state(self) -> dict[str, Any]:
        """All that the next ``collect`` depends on besides the weights."""
        return {
            "env": self.env.unwrapped.get_state() if hasattr(self.env.unwrapped, "get_state") else None,
            "obs": None if self._obs is None else self._obs.copy(),
            "ended": self._ended.copy(),
            "returns": self._returns.copy(),
            "lengths": self._lengths.copy(),
            "random": self._random.bit_generator.state,
            "n_step": None if self._n_step is None else self._n_step.get_state(),
        }

    def set_rollout_state(self, state: dict[str, Any]) -> None:
        """Go on where ``rollout_state`` was taken; with another number of environments, begin new episodes."""
        self._random.bit_generator.state = state["random"]
        if state["env"] is None or len(state["ended"]) != self.num_envs:
            self._obs = None
            return
        self.env.unwrapped.set_state(state["env"])
        self._obs, self._ended = state["obs"], state["ended"].copy()
        self._returns, self._lengths = state["returns"].copy(), state["lengths"].copy()
        if self._n_step is not None and state.get("n_step"):
            self._n_step.set_state(state["n_step"])

    def _begin(self, env: Any) -> None:
        self._obs, _ = env.reset(seed=int(self._random.integers(2**31)))
        self._ended[:] = False
        self._returns[:] = 0.0
        self._lengths[:] = 0
        if self._n_step is not None:
            self._n_step.clear()

    def _n_step_returns(self) -> NStepReturns:
        env = self.env.unwrapped
        widths = env.single_observation_space.shape[0], env.single_action_space.shape[0]
        return NStepReturns(self.config.n_step, self.config.gamma, self.num_envs, *widths)

    def _uniform_actions(self, env: Any) -> np.ndarray:
        space = env.single_action_space
        draws = self._random.random((self.num_envs, *space.shape))
        return (space.low + draws * (space.high - space.low)).astype(np.float32)

    def _policy_actions(self, obs: np.ndarray, env: Any) -> np.ndarray:
        noise = self._random.standard_normal((len(obs), *env.single_action_space.shape), dtype=np.float32)
        with torch.no_grad():
            return self.module.explore(aligned(torch.from_numpy(obs)), torch.from_numpy(noise)).numpy()
