"""A batch of meshing episodes: their memory, and the few calls that environments are made of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs import front as fr
from envs import transition
from envs.mesh import Mesh
from envs.types import Domain, Floats, MeshingParameters


class Episodes:
    """B episodes over a fixed list of domains, stepped together by compiled code.

    Attributes:
        domains: the domains an episode can be on.
        parameters: the MDP's numbers.
        domain_of: (B,) int64, index into ``domains`` of each episode.
        out: the last outcome (arrays that the next step overwrites).
    """

    def __init__(self, domains: Sequence[Domain], parameters: MeshingParameters, batch: int) -> None:
        if not domains:
            raise ValueError("no domain to mesh: give at least one")
        for domain in domains:
            if len(domain.ring) < 6:
                raise ValueError(
                    f"{domain.name}: a ring of {len(domain.ring)} vertices is one element already; "
                    "an episode needs at least 6"
                )
        self.domains = list(domains)
        self.parameters = parameters
        self.caps = np.array([fr.element_cap(domain, parameters) for domain in domains], dtype=np.int64)
        slots = max(fr.capacity(domain, parameters) for domain in domains)
        points = max(len(domain.points) for domain in domains)
        # One more element than the cap: the last action of a mesh cuts two.
        elements = int(self.caps.max()) + 1
        room = points + elements * (2 if parameters.type2 else 1)
        self._templates = self._stack([fr.template(domain, parameters, slots) for domain in domains], points)
        self._fronts = fr.allocate(batch, slots, room, elements)
        self._numbers = transition.numbers(parameters)
        self.out = transition.outcome(batch, parameters)
        self.domain_of = np.zeros(batch, dtype=np.int64)
        self._nobody = np.zeros(batch, dtype=np.bool_)

    @staticmethod
    def _stack(templates: list[fr.Front], points: int) -> fr.Front:
        padded = [t._replace(points=np.pad(t.points, ((0, points - len(t.points)), (0, 0)))) for t in templates]
        return fr.Front(*(np.stack(arrays) for arrays in zip(*padded, strict=True)))

    def __len__(self) -> int:
        return len(self.domain_of)

    def start(self, i: int, domain: int) -> None:
        """Begin episode ``i`` afresh on ``domains[domain]``; its observation is in ``out``."""
        self.domain_of[i] = domain
        self.out.terminated[i] = self.out.truncated[i] = False
        transition.start(self._fronts, self._templates, i, domain, self._numbers, self.out)

    def step(self, actions: np.ndarray, skip: np.ndarray | None = None) -> transition.Outcome:
        """Take one action in each episode.

        Args:
            actions: (B, action size), clipped to [-1, 1]; not finite is an error.
            skip: (B,) bool, episodes to leave as they are.

        Returns:
            ``out``, overwritten by the next call.

        Raises:
            ValueError: an action has the wrong shape or is not finite, or an episode is over and was not begun anew.
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
        transition.step_batch(self._fronts, clipped, nobody, self._numbers, self.caps[self.domain_of], self.out)
        return self.out

    def front(self, i: int) -> fr.Front:
        """The working memory of episode ``i`` (views)."""
        return fr.Front(*(array[i] for array in self._fronts))

    def domain(self, i: int) -> Domain:
        """The domain that episode ``i`` is on."""
        return self.domains[self.domain_of[i]]

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

    def get_state(self) -> dict[str, np.ndarray]:
        """Everything that the next step depends on; arrays to be given back to ``set_state``."""
        names = [*fr.Front._fields, *transition.Outcome._fields, "domain_of"]
        return dict(zip(names, (array.copy() for array in (*self._fronts, *self.out, self.domain_of)), strict=True))

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on where ``get_state`` was taken, with the same domains, parameters and batch.

        Raises:
            ValueError: the state is of other sizes.
        """
        targets = self.get_state()
        if {k: v.shape for k, v in targets.items()} != {k: v.shape for k, v in state.items()}:
            raise ValueError("the state is of episodes with other domains, parameters or batch size")
        arrays = (*self._fronts, *self.out, self.domain_of)
        for name, array in zip(targets, arrays, strict=True):
            array[:] = state[name]
