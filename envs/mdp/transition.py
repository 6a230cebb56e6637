"""The one step function of the MDP, and its loop over a batch. Training, evaluation and meshing all go through here."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import compiled, inlined
from envs.mdp.action import ACCEPTED, Cut, decode, decode_type
from envs.mdp.front import (
    A_MAX,
    A_MIN,
    ELEMENTS,
    ETA_SUM,
    INVALID,
    RETURN,
    RING,
    STEPS,
    Front,
    advance,
    close,
    reference_slot,
    restart,
    row,
)
from envs.mdp.observation import observation_size, observe
from envs.mdp.reward import (
    INVALID_REWARD,
    LAST_REWARD,
    element_area,
    eta_b,
    eta_b_released,
    eta_e,
    invalid_released,
    mu,
    mu_local,
    nu,
)
from envs.quality import eta_from_angles, inner_angles
from envs.types import DENSITIES, SOURCES, Floats, Ints, MeshingParameters

#: Indices into DENSITIES.
CONTINUOUS, _, LOCAL = range(3)
#: Into SOURCES.
RELEASED = 1


class Numbers(NamedTuple):
    """MeshingParameters as compiled code takes them; see there."""

    n: int
    g: int
    beta: float
    n_rv: int
    alpha: float
    sized: bool
    M_angle: float
    boundary: int
    invalid: int
    density: int
    upsilon: float
    extended: bool
    irregular: float
    type2: bool
    max_invalid: int


class Outcome(NamedTuple):
    """What a step of a batch of B episodes yields; arrays that are written in place.

    Attributes:
        observation: (B, size) float32.
        reward: (B,) float64.
        terms: (B, 4) float64: eta_e, eta_b, mu, nu (weighted); zeros for an invalid and for the last element.
        rejection: (B,) int64, index into action.REJECTIONS (0: accepted).
        action_type: (B,) int64, index into action.ACTION_TYPES: what was asked for.
        terminated, truncated: (B,) bool.
    """

    observation: np.ndarray
    reward: Floats
    terms: Floats
    rejection: Ints
    action_type: Ints
    terminated: np.ndarray
    truncated: np.ndarray


def numbers(parameters: MeshingParameters) -> Numbers:
    """The compiled view of the parameters."""
    values = {name: getattr(parameters, name) for name in Numbers._fields}
    words = {"boundary": SOURCES, "invalid": SOURCES, "density": DENSITIES}
    return Numbers(**values | {name: known.index(values[name]) for name, known in words.items()})


def outcome(batch: int, parameters: MeshingParameters) -> Outcome:
    """Room for the outcome of a batch."""
    return Outcome(
        observation=np.zeros((batch, observation_size(parameters)), dtype=np.float32),
        reward=np.zeros(batch),
        terms=np.zeros((batch, 4)),
        rejection=np.zeros(batch, dtype=np.int64),
        action_type=np.zeros(batch, dtype=np.int64),
        terminated=np.zeros(batch, dtype=np.bool_),
        truncated=np.zeros(batch, dtype=np.bool_),
    )


@inlined
def ring_quality(front: Front) -> float:
    """eta_e of the 4-ring that is left."""
    a = reference_slot(front)
    b = front.nxt[a]
    c, d = front.nxt[b], front.nxt[front.nxt[b]]
    ax, ay, bx, by = front.xy[a, 0], front.xy[a, 1], front.xy[b, 0], front.xy[b, 1]
    cx, cy, dx, dy = front.xy[c, 0], front.xy[c, 1], front.xy[d, 0], front.xy[d, 1]
    alpha, beta, gamma, delta = inner_angles(ax, ay, bx, by, cx, cy, dx, dy)
    return eta_from_angles(ax, ay, bx, by, cx, cy, dx, dy, alpha, beta, gamma, delta)


@inlined
def look(front: Front, numbers: Numbers, out: Floats) -> None:
    """Observe the reference vertex."""
    observe(front, reference_slot(front), numbers.n, numbers.g, numbers.beta, numbers.extended, numbers.sized, out)


@inlined
def terms(front: Front, cut: Cut, numbers: Numbers) -> tuple[float, float, float, float]:
    """The reward's terms of an accepted element, the front as it was before it: eta_e, eta_b, mu, nu weighted."""
    area = element_area(cut)
    if numbers.density == LOCAL:
        density = mu_local(front, cut, area, numbers.upsilon)
    else:
        density = mu(area, front.measure[A_MIN], front.measure[A_MAX], numbers.density == CONTINUOUS)
    irregularity = numbers.irregular * nu(front, cut) if numbers.irregular > 0.0 else 0.0
    if numbers.boundary == RELEASED:
        boundary = eta_b_released(front, cut, numbers.M_angle)
    else:
        boundary = eta_b(cut, numbers.M_angle)
    return eta_e(cut), boundary, density, irregularity


@inlined
def take(front: Front, cut: Cut, n_rv: int) -> None:
    """Cut an accepted element off the front."""
    x, y, k = cut.x, cut.y, cut.k
    new = (k + 1) & 3
    advance(front, cut.start, k, x[new], y[new], x[3], y[3], element_area(cut), n_rv)


@inlined
def transition(front: Front, action: Floats, numbers: Numbers, out: Outcome, i: int, cap: int) -> None:
    """Advance one episode by one action and write row ``i`` of ``out``.

    Args:
        front: changed in place when the action is valid, else only its counters.
        action: (3,) or (5,) in [-1, 1]; anything outside is clipped by the caller.
        cap: elements at which the episode is truncated.
    """
    reference = reference_slot(front)
    cut = decode(front, reference, action, numbers.n, numbers.alpha, numbers.sized, numbers.type2)
    out.action_type[i] = decode_type(action[0], numbers.type2)
    out.rejection[i] = cut.rejection
    out.terms[i, :] = 0.0
    out.terminated[i] = False
    front.counts[STEPS] += 1
    if cut.rejection != ACCEPTED:
        front.counts[INVALID] += 1
        released = numbers.invalid == RELEASED
        out.reward[i] = invalid_released(front.counts[ELEMENTS]) if released else INVALID_REWARD
        out.truncated[i] = front.counts[INVALID] >= numbers.max_invalid
    else:
        front.counts[INVALID] = 0
        quality, boundary, density, irregularity = terms(front, cut, numbers)
        take(front, cut, numbers.n_rv)
        front.measure[ETA_SUM] += quality
        if front.counts[RING] == 4:
            front.measure[ETA_SUM] += ring_quality(front)
            close(front)
            out.reward[i] = LAST_REWARD
            out.terminated[i] = True
            out.truncated[i] = False
        else:
            out.terms[i, 0], out.terms[i, 1] = quality, boundary
            out.terms[i, 2], out.terms[i, 3] = density, irregularity
            out.reward[i] = quality + boundary + density + irregularity
            out.truncated[i] = front.counts[ELEMENTS] >= cap
            look(front, numbers, out.observation[i])
    front.measure[RETURN] += out.reward[i]


@compiled
def start(batch: Front, templates: Front, i: int, domain: int, numbers: Numbers, out: Outcome) -> None:
    """Begin episode ``i`` of a batch on the given domain's template and observe it."""
    front = row(batch, i)
    restart(front, row(templates, domain))
    look(front, numbers, out.observation[i])


@compiled
def step_batch(batch: Front, actions: Floats, skip: np.ndarray, numbers: Numbers, caps: Ints, out: Outcome) -> None:
    """Step every episode of a batch, but for those in ``skip``.

    Args:
        batch: working memory of B episodes.
        actions: (B, 3) or (B, 5) float64 in [-1, 1].
        skip: (B,) bool, episodes to leave alone.
        numbers: the MDP's numbers.
        caps: (B,) int64, element cap of each episode.
        out: written in place.
    """
    for i in range(len(actions)):
        if not skip[i]:
            transition(row(batch, i), actions[i], numbers, out, i, caps[i])
