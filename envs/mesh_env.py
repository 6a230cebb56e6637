"""``FreeMesh-v0``: one domain, one agent, one element a step (paper, section "RL based mesh generation")."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from envs.domains.load import source
from envs.mdp.action import ACTION_TYPES, REJECTIONS
from envs.mdp.episodes import Episodes
from envs.mdp.observation import bounds
from envs.rendering.frame import SIZE, draw_episode
from envs.rendering.window import Window
from envs.types import NAMED, SETTINGS, Domain, DomainSupply, MeshingParameters

#: What a domain can be given as: a name, a file, or the thing itself; several are drawn from at each reset.
DomainSpec = str | Domain | DomainSupply | Sequence[str | Domain | DomainSupply]


def domains_of(spec: DomainSpec) -> list[Domain | DomainSupply]:
    """The domains that a specification means, in its order.

    Raises:
        DomainError: unknown name, or a file that cannot be meshed.
    """
    given = list(spec) if isinstance(spec, Sequence) and not isinstance(spec, str) else [spec]
    return [source(one) if isinstance(one, str) else one for one in given]


def parameters_of(options: Mapping[str, Any], base: MeshingParameters | None = None) -> MeshingParameters:
    """``base``, by default the paper's, with the options in place of its numbers.

    Args:
        options: fields of MeshingParameters, or the paper's names for several (``observation="O2"``, ``radius="R2"``);
            a field overrides a name.
        base: what holds where no option is given.

    Raises:
        ValueError: unknown option or name, or a value out of its range.
    """
    numbers = dict(options)
    for option, names in NAMED.items():
        if (name := numbers.pop(option, None)) is not None:
            if name not in names:
                raise ValueError(f"{option} = {name!r}: use one of {', '.join(names)}")
            numbers = names[name] | numbers
    for option in numbers:
        if option not in SETTINGS:
            raise ValueError(f"unknown environment option {option!r}; known: {', '.join([*SETTINGS, *NAMED])}")
    return replace(base or MeshingParameters(), **numbers)


def spaces_of(
    parameters: MeshingParameters, observed: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[spaces.Box, spaces.Box]:
    """Observation and action space of one environment; ``observed`` is the range of observations of a user's own."""
    low, high = observed or bounds(parameters)
    return (
        spaces.Box(low, high, dtype=np.float32),
        spaces.Box(-1.0, 1.0, (parameters.action_size,), dtype=np.float32),
    )


class Task:
    """Which of an environment's domains the next episodes are drawn from.

    Attributes:
        weights: (domains,) float64, adding up to 1.
    """

    def __init__(self, domains: Sequence[Domain | DomainSupply]) -> None:
        self.names = [domain.name for domain in domains]
        self.weights = np.full(len(domains), 1.0 / len(domains))

    def get(self) -> dict[str, float]:
        """Weight of each domain by name."""
        return dict(zip(self.names, self.weights.tolist(), strict=True))

    def set(self, weights: Mapping[str, float]) -> None:
        """Draw the next episodes from these domains alone, in proportion to their weights.

        Raises:
            ValueError: an unknown domain, a negative weight, or none above zero.
        """
        unknown = [name for name in weights if name not in self.names]
        if unknown:
            raise ValueError(f"task names {', '.join(unknown)}; this environment has {', '.join(self.names)}")
        chosen = np.array([weights.get(name, 0.0) for name in self.names], dtype=np.float64)
        if (chosen < 0).any() or not 0 < chosen.sum() < np.inf:
            raise ValueError(f"task weights {dict(weights)}: none may be negative, and one must be positive")
        self.weights = chosen / chosen.sum()

    def draw(self, random: np.random.Generator) -> int:
        """The index of a domain, by one random number; by none where there is only one."""
        if len(self.weights) == 1:
            return 0
        return int(
            np.searchsorted(np.cumsum(self.weights), random.random(), side="right").clip(max=len(self.names) - 1)
        )


class MeshEnv(gym.Env[np.ndarray, np.ndarray]):
    """Cut quadrilaterals off a domain's boundary until nothing is left.

    Args:
        domain: a catalogue name, a file, ``random-SEED``, ``random`` (a new one every time), a Domain, or several of
            them to draw from at each reset.
        render_mode: ``"rgb_array"``, None, or ``"human"``: a window that shows every step, by pygame.
        parameters: the numbers of the MDP, by default the paper's.
        reward: a function of an ``envs.mdp.user_defined.Step`` in place of the paper's reward, or its name,
            ``package.module:Name``.
        observe: a class of observations in place of the paper's, likewise: made with the parameters it has ``low`` and
            ``high``, (size,) each, and is called with an ``envs.mdp.user_defined.View``.
        options: what differs from the parameters, see `parameters_of`.

    Observation, action, reward and the end of an episode: see the files of ``envs.mdp``.

    ``info`` of a step: ``eta_e``, ``eta_b``, ``mu``, ``nu`` (the reward's terms), ``rejection`` (empty, or why the
    action was invalid), ``action_type`` (one of ``envs.mdp.action.ACTION_TYPES``). When the episode ends also ``mesh``
    (a Mesh), ``completed``, ``elements``, ``mean_eta``, ``domain`` and ``task`` (what the domain was drawn as).
    ``info`` of a reset: ``domain``.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 10}  # noqa: RUF012  (gymnasium's own convention)

    def __init__(
        self,
        domain: DomainSpec = "T1",
        render_mode: str | None = None,
        parameters: MeshingParameters | None = None,
        reward: Any = None,
        observe: Any = None,
        **options: Any,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode = {render_mode!r}: use 'human', 'rgb_array' or None")
        self.render_mode = render_mode
        self._window = Window(SIZE, SIZE, "FreeMesh-v0") if render_mode == "human" else None
        self.parameters = parameters_of(options, parameters)
        self.episodes = Episodes(domains_of(domain), self.parameters, 1, reward=reward, observe=observe)
        self.task = Task(self.episodes.domains)
        self.observation_space, self.action_space = spaces_of(self.parameters, self.episodes.bounds)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; the seed decides which domain, when there are several."""
        super().reset(seed=seed)
        self.episodes.start(0, self.task.draw(self.np_random), self.np_random)
        self._show()
        return self.episodes.out.observation[0].copy(), {"domain": self.episodes.domain(0).name}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Cut the element that ``action`` asks for, or reject it and leave the front as it is."""
        out = self.episodes.step(np.asarray(action)[None])
        eta_e, eta_b, mu, nu = out.terms[0].tolist()
        info: dict[str, Any] = {
            "eta_e": eta_e, "eta_b": eta_b, "mu": mu, "nu": nu,
            "rejection": REJECTIONS[out.rejection[0]], "action_type": ACTION_TYPES[out.action_type[0]],
        }  # fmt: skip
        terminated, truncated = bool(out.terminated[0]), bool(out.truncated[0])
        if terminated or truncated:
            info |= ending(self.episodes, 0)
        self._show()
        return out.observation[0].copy(), float(out.reward[0]), terminated, truncated, info

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """(height, width, 3) uint8: the elements, the front, and the reference vertex; None where a window shows it."""
        return draw_episode(self.episodes, 0) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()

    def _show(self) -> None:
        if self._window is not None:
            self._window.show(draw_episode(self.episodes, 0), self.metadata["render_fps"])


def ending(episodes: Episodes, i: int) -> dict[str, Any]:
    """The entries of ``info`` that only the last step of an episode has."""
    mesh = episodes.mesh(i)
    return {
        "mesh": mesh,
        "completed": mesh.complete,
        "elements": episodes.elements(i),
        "mean_eta": episodes.mean_eta(i),
        "domain": mesh.name,
        "task": episodes.task(i),
    }
