"""What a user may bring to the MDP: the reward of every step, and what is observed of every front."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from envs.plug_ins.lookup import function, subclass
from envs.plug_ins.named_object import PlugIn
from envs.types import Domain, Floats, MeshingParameters


class Step(NamedTuple):
    """A step, as a reward sees it.

    Attributes:
        reward: the paper's.
        eta_e, eta_b, mu, nu: its terms; 0 for an invalid action and for the last element.
        rejection: why the action was invalid, one of ``envs.mdp.action.REJECTIONS``; empty where it was valid.
        elements: (k, 4, 2) float64, the corners of what was cut, counter-clockwise: one element, none where the action
            was invalid, two where the mesh was completed.
        area: what is left of the domain's area, [0, 1].
        cut: elements cut so far.
        completed: whether the mesh is complete.
        truncated: whether the episode ended without.
        domain: what is meshed.
    """

    reward: float
    eta_e: float
    eta_b: float
    mu: float
    nu: float
    rejection: str
    elements: Floats
    area: float
    cut: int
    completed: bool
    truncated: bool
    domain: Domain


class View(NamedTuple):
    """A front, as an observation sees it.

    Attributes:
        observation: (size,) float32, the paper's.
        front: (m, 2) float64, the vertices of the front, counter-clockwise, the reference vertex first.
        area: what is left of the domain's area, [0, 1].
        cut: elements cut so far.
        domain: what is meshed.
    """

    observation: np.ndarray
    front: Floats
    area: float
    cut: int
    domain: Domain


class Observer:
    """A class of observations, made for the MDP's parameters.

    Attributes:
        low, high: (size,) float32, the range of every entry.
    """

    def __init__(self, named: Any, parameters: MeshingParameters) -> None:
        """Make one.

        Raises:
            PluginError: there is no such class, or it has no ``low`` and ``high`` of one length.
        """
        found = subclass(named, "env.observe", object, "a class of observations")
        self._made = made = PlugIn(found.key, found.spec, found(parameters), found.file)
        try:
            self.low, self.high = (np.array(getattr(made.value, end), dtype=np.float32) for end in ("low", "high"))
        except (AttributeError, TypeError, ValueError):
            raise made.wrong("has no low and high", "set both, the range of every entry, (size,) each") from None
        sizes = self.low.shape, self.high.shape
        if self.low.ndim != 1 or not self.low.size or len(set(sizes)) > 1 or not (self.low <= self.high).all():
            raise made.wrong(f"has low {sizes[0]} and high {sizes[1]}", "give (size,) numbers each, low <= high")
        if not callable(self._made.value):
            raise self._made.wrong("cannot be called", "give it __call__(self, view)")

    def observe(self, view: View, out: np.ndarray) -> None:
        """Write the observation of a front into ``out``, (size,) float32.

        Raises:
            PluginError: it raised, or returned anything but ``size`` finite numbers.
        """
        returned = self._made(view)
        try:
            found = np.asarray(returned, dtype=np.float32)
        except (TypeError, ValueError):
            raise self._made.wrong(f"returned {returned!r:.60}", f"return {len(self.low)} numbers") from None
        if found.shape != self.low.shape:
            raise self._made.wrong(f"returned {found.shape}", f"return {self.low.shape}, as low and high are")
        if not np.isfinite(found).all():
            raise self._made.wrong(f"returned {found[~np.isfinite(found)][0]}", "return finite numbers")
        out[:] = found


def reward(named: Any) -> PlugIn:
    """The reward of a name, or of a function.

    Raises:
        PluginError: it is none.
    """
    return function(named, "env.reward", "a function of a step")
