"""The native batched environment: one call steps all episodes in compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from envs.mdp.action import ACTION_TYPES, REJECTIONS
from envs.mdp.episodes import Episodes
from envs.mesh_env import DomainSpec, Task, domains_of, ending, parameters_of, spaces_of
from envs.rendering.frame import draw_episode
from envs.types import MeshingParameters

_REJECTIONS = np.array(REJECTIONS)
_ACTION_TYPES = np.array(ACTION_TYPES)


class MeshVectorEnv(VectorEnv):
    """``num_envs`` episodes of FreeMesh-v0; each goes step for step as in a MeshEnv with the same seed and actions.

    Autoreset is NEXT_STEP: the step after an episode's end ignores the action, begins a new episode and returns its
    first observation with reward 0. Infos are as MeshEnv's, as arrays with Gymnasium's ``_key`` masks. There are no
    single environments in it: wrap it with ``gymnasium.wrappers.vector``, or make a ``sync`` or ``async`` one.

    Args:
        num_envs: B >= 1.
        domain, render_mode, parameters, reward, observe, options: see MeshEnv.
    """

    metadata = {  # noqa: RUF012  (gymnasium's own convention)
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        domain: DomainSpec = "T1",
        render_mode: str | None = None,
        parameters: MeshingParameters | None = None,
        reward: Any = None,
        observe: Any = None,
        **options: Any,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs = {num_envs}: must be at least 1")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode = {render_mode!r}: use 'rgb_array' or None")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.parameters = parameters_of(options, parameters)
        self.episodes = Episodes(domains_of(domain), self.parameters, num_envs, reward=reward, observe=observe)
        self.task = Task(self.episodes.domains)
        self.single_observation_space, self.single_action_space = spaces_of(self.parameters, self.episodes.bounds)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self._randoms = [seeding.np_random(None)[0] for _ in range(num_envs)]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin all episodes, or those of ``options["reset_mask"]``; episode i is seeded with ``seed + i``."""
        mask = np.ones(self.num_envs, dtype=np.bool_) if options is None else options.get("reset_mask")
        mask = np.ones(self.num_envs, dtype=np.bool_) if mask is None else np.asarray(mask, dtype=np.bool_)
        seeds = [None if seed is None else seed + i for i in range(self.num_envs)] if (
            seed is None or isinstance(seed, int)
        ) else list(seed)  # fmt: skip
        for i in np.flatnonzero(mask).tolist():
            if seeds[i] is not None:
                self._randoms[i] = seeding.np_random(seeds[i])[0]
            self._begin(i)
        self._ended[mask] = False
        return self.episodes.out.observation.copy(), {"domain": self._domain_names(), "_domain": mask}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One action in every episode; actions (B, 3) or (B, 5) in [-1, 1]."""
        out, began = self.episodes.out, self._ended
        self.episodes.step(actions, skip=began)
        if began.any():
            began = began.copy()
            out.reward[began] = 0.0
            out.terms[began] = 0.0
            out.rejection[began] = 0
            out.terminated[began] = out.truncated[began] = False
            for i in np.flatnonzero(began).tolist():
                self._begin(i)
        stepped = ~began
        terms = out.terms.copy()
        infos: dict[str, Any] = {
            "eta_e": terms[:, 0], "_eta_e": stepped,
            "eta_b": terms[:, 1], "_eta_b": stepped,
            "mu": terms[:, 2], "_mu": stepped,
            "nu": terms[:, 3], "_nu": stepped,
            "rejection": _REJECTIONS[out.rejection], "_rejection": stepped,
            "action_type": _ACTION_TYPES[out.action_type], "_action_type": stepped,
        }  # fmt: skip
        self._ended = out.terminated | out.truncated
        if self._ended.any():
            self._tell_endings(infos)
        return (
            out.observation.copy(),
            out.reward.copy(),
            out.terminated.copy(),
            out.truncated.copy(),
            infos,
        )

    def render(self) -> tuple[np.ndarray, ...] | None:  # type: ignore[override]
        """One picture an episode, (height, width, 3) uint8."""
        if self.render_mode != "rgb_array":
            return None
        return tuple(draw_episode(self.episodes, i) for i in range(self.num_envs))

    def get_state(self) -> dict[str, Any]:
        """Everything that the next step depends on, for a checkpoint in mid-episode."""
        return {
            "episodes": self.episodes.get_state(),
            "ended": self._ended.copy(),
            "randoms": [random.bit_generator.state for random in self._randoms],
            "task": self.task.get(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on where ``get_state`` was taken."""
        self.episodes.set_state(state["episodes"])
        self._ended = state["ended"].copy()
        for random, saved in zip(self._randoms, state["randoms"], strict=True):
            random.bit_generator.state = saved
        self.task.set(state["task"])

    def _begin(self, i: int) -> None:
        self.episodes.start(i, self.task.draw(self._randoms[i]), self._randoms[i])

    def _domain_names(self) -> np.ndarray:
        return np.array([self.episodes.domain(i).name for i in range(self.num_envs)])

    def _tell_endings(self, infos: dict[str, Any]) -> None:
        for i in np.flatnonzero(self._ended).tolist():
            for key, value in ending(self.episodes, i).items():
                if key not in infos:
                    dtype = object if key in ("mesh", "domain", "task") else type(value)
                    infos[key] = np.zeros(self.num_envs, dtype=dtype)
                    infos[f"_{key}"] = self._ended.copy()
                infos[key][i] = value
