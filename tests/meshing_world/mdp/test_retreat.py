"""Taking elements back is the exact inverse of cutting them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import load
from envs.mdp import front as fr
from envs.mdp.action import ACCEPTED, decode_type
from envs.mdp.front import ELEMENTS, RING, Front, reference_slot
from envs.mdp.transition import Numbers, numbers
from envs.types import MeshingParameters
from freemesh_ray.mesher.undo_log import WIDE, UndoLog, cut_action, element, take_back, undo_log

#: random:3 has a seam; random:20 is small, so that its games reach short rings.
DOMAINS = ("T1", "random:3", "random:20", "random:11")
ROOM = 200


def begun(name: str, n_rv: int) -> tuple[Front, UndoLog, Numbers]:
    """A fresh front with room for elements of all types."""
    parameters, domain = MeshingParameters(n_rv=n_rv, type2=True), load(name)
    start = fr.template(domain, parameters, fr.capacity(len(domain.ring), parameters))
    return fr.with_room(start, 2 * ROOM, ROOM), undo_log(ROOM), numbers(parameters)


def copy(front: Front) -> Front:
    return Front(*(array.copy() for array in front))


def assert_same(front: Front, other: Front) -> None:
    """Bit for bit."""
    for name, one, two in zip(Front._fields, front, other, strict=True):
        assert one.tobytes() == two.tobytes(), name


def play(front: Front, log: UndoLog, mdp: Numbers, seed: int, steps: int) -> list[Front]:
    """Cut elements asked for by random actions; the fronts before each."""
    random, before = np.random.default_rng(seed), []
    for _ in range(steps):
        action = random.uniform(-1.0, 1.0, 5)
        # Type 0 shortens the ring, and is rarely valid: ask for it often.
        action[0] = random.choice([action[0], -1.0, 0.25])
        slot = int(random.choice(fr.ring_slots(front))) if random.random() < 0.5 else reference_slot(front)
        if front.counts[RING] == 4 or front.counts[ELEMENTS] == ROOM - 1:
            break
        if element(front, slot, action, True, mdp).rejection == ACCEPTED:
            before.append(copy(front))
            cut_action(front, log, slot, action, True, WIDE, mdp)
    return before


@pytest.mark.slow
@settings(max_examples=60)
@given(st.sampled_from(DOMAINS), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_each_element_taken_back_restores_the_front_bit_for_bit(name: str, n_rv: int, seed: int) -> None:
    front, log, mdp = begun(name, n_rv)
    for earlier in reversed(play(front, log, mdp, seed, 400)):
        take_back(front, log, 1, n_rv)
        assert_same(front, earlier)


@settings(max_examples=20)
@given(st.sampled_from(DOMAINS), st.integers(0, 2**32 - 1), st.integers(0, 60))
def test_several_taken_back_at_once_and_cut_again(name: str, seed: int, back: int) -> None:
    front, log, mdp = begun(name, 2)
    fronts = [*play(front, log, mdp, seed, 400), copy(front)]
    take_back(front, log, back, 2)
    assert_same(front, fronts[max(0, len(fronts) - 1 - back)])
    play(front, log, mdp, seed + 1, 100)
    take_back(front, log, ROOM, 2)
    assert_same(front, fronts[0])


def test_all_kinds_were_played() -> None:
    front, log, mdp = begun("T1", 2)
    play(front, log, mdp, 0, 2000)
    types = {int(one) for one in log.action_type[: front.counts[ELEMENTS]]}
    assert types == {decode_type(value, True) for value in (-0.9, -0.4, 0.1, 0.9)}
