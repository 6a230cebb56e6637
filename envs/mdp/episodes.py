"""A batch of meshing episodes: their memory, and the few calls that environments are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from envs.mdp import front as fr
from envs.mdp import size_field, transition, user_defined
from envs.mdp.action import REJECTIONS
from envs.mdp.observation import bounds
from envs.mesh import Mesh
from envs.types import Domain, DomainSupply, Floats, MeshingParameters


class Episodes:
    """B episodes over a fixed list of domains and endless supplies of them, stepped together by compiled code.

    Attributes:
        domains: what an episode can be on.
        parameters: the MDP's numbers.
        domain_of: (B,) int64, index into ``domains`` of each episode.
        out: the last outcome (arrays that the next step overwrites).
        bounds: the lowest and highest value of every entry of an observation, (size,) float32 each.
    """

    def __init__(
        self,
        domains: Sequence[Domain | DomainSupply],
        parameters: MeshingParameters,
        batch: int,
        *,
        reward: Any = None,
        observe: Any = None,
    ) -> None:
        """Make room for them.

        Args:
            domains: what an episode can be on.
            parameters: the MDP's numbers.
            batch: B.
            reward: a function of a `user_defined.Step` in place of the paper's reward, or its name.
            observe: a class of observations of a `user_defined.View` in place of the paper's, or its name.

        Raises:
            PluginError: one of the two cannot be had.
        """
        if not domains:
            raise ValueError("no domain to mesh: give at least one")
        fixed = [domain for domain in domains if isinstance(domain, Domain)]
        supplies = [domain for domain in domains if not isinstance(domain, Domain)]
        for domain in fixed:
            if len(domain.ring) < 6:
                raise ValueError(
                    f"{domain.name}: a ring of {len(domain.ring)} vertices is one element already; "
                    "an episode needs at least 6"
                )
        self.domains = list(domains)
        self.parameters = parameters
        slots = [fr.capacity(len(domain.ring), parameters) for domain in fixed]
        slots += [fr.capacity(supply.vertices, parameters) for supply in supplies]
        points = [len(domain.points) for domain in fixed] + [supply.vertices for supply in supplies]
        caps = [fr.element_cap(domain, parameters) for domain in fixed] + [supply.elements for supply in supplies]
        self._slots, self._points = max(slots), max(points)
        self._sources = size_field.capacity(self._points)
        # One more element than the cap: the last action of a mesh cuts two.
        self._most_elements = max(caps)
        elements = self._most_elements + 1
        room = self._points + elements * (2 if parameters.type2 else 1)
        # One template a domain, then one an episode, for what it draws from a supply.
        rows = len(domains) + (batch if supplies else 0)
        self._templates = fr.allocate(rows, self._slots, self._points, 0, self._sources)
        self._caps = np.zeros(rows, dtype=np.int64)
        self._drawn: list[Domain | None] = [None] * batch
        for k, entry in enumerate(domains):
            if isinstance(entry, Domain):
                self._prepare(k, entry)
        fields = {name: getattr(self._templates, name) for name in fr.FIELD}
        self._fronts = fr.allocate(batch, self._slots, room, elements, 1)._replace(**fields)
        self._numbers = transition.numbers(parameters)
        self._outcome = self.out = transition.outcome(batch, parameters)
        self._reward = None if reward is None else user_defined.reward(reward)
        self._observer = None if observe is None else user_defined.Observer(observe, parameters)
        self.bounds = bounds(parameters)
        if self._observer is not None:
            self.bounds = self._observer.low, self._observer.high
            self.out = self._outcome._replace(observation=np.zeros((batch, len(self._observer.low)), dtype=np.float32))
        self.domain_of = np.zeros(batch, dtype=np.int64)
        self._row_of = np.zeros(batch, dtype=np.int64)
        self._nobody = np.zeros(batch, dtype=np.bool_)

    def _prepare(self, row: int, domain: Domain) -> None:
        """Make ``domain`` the template in ``row``."""
        template = fr.template(domain, self.parameters, self._slots, self._sources)
        for target, array in zip(self._templates, template, strict=True):
            target[row, : len(array)] = array
            target[row, len(array) :] = 0  # nothing stays of a larger domain before it
        self._templates.field[row] = row
        self._caps[row] = min(fr.element_cap(domain, self.parameters), self._most_elements)

    def __len__(self) -> int:
        return len(self.domain_of)

    def start(self, i: int, domain: int, random: np.random.Generator | None = None) -> None:
        """Begin episode ``i`` afresh on ``domains[domain]``; its observation is in ``out``.

        Args:
            i: the episode.
            domain: index into ``domains``.
            random: what a supply draws with; a fixed domain needs none.
        """
        entry, row = self.domains[domain], domain
        if not isinstance(entry, Domain):
            row = len(self.domains) + i
            drawn = entry.draw(np.random.default_rng() if random is None else random)
            self._drawn[i] = drawn
            self._prepare(row, drawn)
        self.domain_of[i], self._row_of[i] = domain, row
        self.out.terminated[i] = self.out.truncated[i] = False
        transition.start(self._fronts, self._templates, i, row, self._numbers, self._outcome)
        if self._observer is not None:
            self._observer.observe(self._view(i), self.out.observation[i])

    def step(self, actions: np.ndarray, skip: np.ndarray | None = None) -> transition.Outcome:
        """Take one action in each episode.

        Args:
            actions: (B, action size), clipped to [-1, 1]; not finite is an error.
            skip: (B,) bool, episodes to leave as they are.

        Returns:
            ``out``, overwritten by the next call.

        Raises:
            ValueError: an action has the wrong shape or is not finite, or an episode is over and was not begun anew.
            PluginError: a reward or an observation of a user's failed.
        """
        actions = np.asarray(actions, dtype=np.float64)
        shape = (len(self), self.parameters.action_size)
        if actions.shape != shape:
            raise ValueError(f"actions have shape {actions.shape}, expected {shape}")
        if not np.isfinite(actions).all():
            raise ValueError(f"action {int(np.flatnonzero(~np.isfinite(actions).all(axis=1))[0])} is not finite")
        clipped = np.clip(actions, -1.0, 1.0)
        nobody = self._nobody if skip is None else skip
        over = (self.out.terminated | self.out.truncated) & ~nobody
        if over.any():
            raise ValueError(f"episode {int(np.flatnonzero(over)[0])} is over: begin it anew before the next step")
        caps = self._caps[self._row_of]
        if self._reward is None and self._observer is None:
            transition.step_batch(self._fronts, clipped, nobody, self._numbers, caps, self.out)
            return self.out
        returns, counts = self._fronts.measure[:, fr.RETURN].copy(), self._fronts.counts[:, fr.ELEMENTS].copy()
        transition.step_batch(self._fronts, clipped, nobody, self._numbers, caps, self._outcome)
        for i in np.flatnonzero(~nobody).tolist():
            if self._reward is not None:
                self.out.reward[i] = self._reward.number(self._step_of(i, int(counts[i])))
                self._fronts.measure[i, fr.RETURN] = returns[i] + self.out.reward[i]
            if self._observer is not None and not self.out.terminated[i]:
                self._observer.observe(self._view(i), self.out.observation[i])
        return self.out

    def _step_of(self, i: int, before: int) -> user_defined.Step:
        """The last step of episode ``i``, which had ``before`` elements."""
        out, front, count = self.out, self.front(i), self.elements(i)
        eta_e, eta_b, mu, nu = out.terms[i].tolist()
        return user_defined.Step(
            reward=float(out.reward[i]),
            eta_e=eta_e,
            eta_b=eta_b,
            mu=mu,
            nu=nu,
            rejection=REJECTIONS[out.rejection[i]],
            elements=front.points[front.quads[before:count]],
            area=self._area_left(i),
            cut=count,
            completed=bool(out.terminated[i]),
            truncated=bool(out.truncated[i]),
            domain=self.domain(i),
        )

    def _view(self, i: int) -> user_defined.View:
        """The front of episode ``i``."""
        paper = self._outcome.observation[i].copy()
        return user_defined.View(paper, self.ring(i), self._area_left(i), self.elements(i), self.domain(i))

    def _area_left(self, i: int) -> float:
        """Share of its domain's area that episode ``i`` has not meshed, [0, 1]."""
        front = self.front(i)
        if front.counts[fr.RING] == 0:
            return 0.0
        return float(np.clip(front.measure[fr.AREA] / front.measure[fr.AREA_0], 0.0, 1.0))

    def front(self, i: int) -> fr.Front:
        """The working memory of episode ``i`` (views)."""
        field = int(self._fronts.field[i, 0])
        views = {name: array[i] for name, array in self._fronts._asdict().items() if name not in fr.FIELD}
        return fr.Front(**views, **{name: getattr(self._fronts, name)[field] for name in fr.FIELD})

    def domain(self, i: int) -> Domain:
        """The domain that episode ``i`` is on."""
        entry = self.domains[self.domain_of[i]]
        if isinstance(entry, Domain):
            return entry
        drawn = self._drawn[i]
        assert drawn is not None
        return drawn

    def task(self, i: int) -> str:
        """The name of what episode ``i`` was begun on: a domain's, or a supply's."""
        return self.domains[self.domain_of[i]].name

    def ring(self, i: int) -> Floats:
        """The front that is left, from the reference vertex on, counter-clockwise; (ring, 2) float64."""
        front = self.front(i)
        return front.xy[fr.ring_slots(front)].copy()

    def mesh(self, i: int) -> Mesh:
        """The elements of episode ``i`` so far."""
        front, domain = self.front(i), self.domain(i)
        return Mesh(
            name=domain.name,
            vertices=front.points[: front.counts[fr.POINTS]].copy(),
            quads=front.quads[: front.counts[fr.ELEMENTS]].copy(),
            segments=domain.segments,
            complete=bool(front.counts[fr.RING] == 0),
        )

    def elements(self, i: int) -> int:
        """Elements cut in episode ``i``."""
        return int(self._fronts.counts[i, fr.ELEMENTS])

    def mean_eta(self, i: int) -> float:
        """Mean eta_e of the elements cut in episode ``i``, in [0, 1]; 0 without elements."""
        return float(self._fronts.measure[i, fr.ETA_SUM] / max(1, self.elements(i)))

    def episode_return(self, i: int) -> float:
        """Undiscounted sum of rewards of episode ``i``."""
        return float(self._fronts.measure[i, fr.RETURN])

    def steps(self, i: int) -> int:
        """Actions taken in episode ``i``, invalid ones included."""
        return int(self._fronts.counts[i, fr.STEPS])

    def get_state(self) -> dict[str, Any]:
        """Everything that the next step depends on, to be given back to ``set_state``.

        Returns:
            ``arrays``: the working memory by name; ``drawn``: for each episode the fields of the domain that it drew
            last, None where it drew none. Nothing but arrays and plain values, in dicts and lists.
        """
        return {
            "arrays": {name: array.copy() for name, array in self._arrays().items()},
            "drawn": [None if domain is None else asdict(domain) for domain in self._drawn],
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on where ``get_state`` was taken, with the same domains, parameters and batch.

        Raises:
            ValueError: the state is of other sizes.
        """
        arrays, given = self._arrays(), state["arrays"]
        if {k: v.shape for k, v in arrays.items()} != {k: v.shape for k, v in given.items()}:
            raise ValueError("the state is of episodes with other domains, parameters or batch size")
        for name, array in arrays.items():
            array[:] = given[name]
        self._drawn = [None if fields is None else Domain(**fields) for fields in state["drawn"]]
        for i, domain in enumerate(self._drawn):
            if domain is not None:
                self._prepare(len(self.domains) + i, domain)
        self._fronts.field[:, 0] = self._row_of

    def _arrays(self) -> dict[str, np.ndarray]:
        names = [*fr.Front._fields, *transition.Outcome._fields, "domain_of", "row_of"]
        arrays = dict(zip(names, (*self._fronts, *self.out, self.domain_of, self._row_of), strict=True))
        arrays = {name: array for name, array in arrays.items() if name not in (*fr.FIELD, "field")}
        return arrays if self._observer is None else arrays | {"paper_observation": self._outcome.observation}
