"""The curriculum: promotion, rehearsal, and a state that survives."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray import config
from freemesh_ray.algorithms.curriculum import Curriculum

STAGES = ("T1", "T2", "T3")


def test_the_defaults_are_those_of_a_configuration() -> None:
    settings = config.load()["curriculum"]
    stages = tuple(settings.pop("stages"))
    assert Curriculum(stages) == Curriculum(stages, **settings)


def curriculum(**settings: object) -> Curriculum:
    return Curriculum(STAGES, **{"promote_at": 0.8, "window": 5, "max_stage_steps": 1000, "rehearsal": 0.3} | settings)


rounds = st.lists(
    st.tuples(st.integers(0, 300), st.lists(st.tuples(st.sampled_from(STAGES), st.booleans()), max_size=8)), max_size=40
)


@given(rounds)
def test_a_stage_never_goes_back_and_moves_by_one(history: list) -> None:
    now = curriculum()
    for steps, episodes in history:
        after = now.after(steps, episodes)
        assert after.stage - now.stage in (0, 1)
        assert len(after.recent) <= after.window
        now = after


@given(rounds)
def test_weights_add_up_to_one_and_rehearse_every_earlier_stage(history: list) -> None:
    now = curriculum()
    for steps, episodes in history:
        now = now.after(steps, episodes)
        task = now.task()
        assert sum(task.values()) == pytest.approx(1.0)
        assert set(task) == set(STAGES[: now.stage + 1])
        assert task[now.name] == pytest.approx(1.0 if now.stage == 0 else 0.7)


@given(rounds, rounds)
def test_a_restored_curriculum_goes_on_as_the_original(before: list, later: list) -> None:
    original = curriculum()
    for steps, episodes in before:
        original = original.after(steps, episodes)
    restored = curriculum().restored(original.state())
    assert restored == original
    for steps, episodes in later:
        original, restored = original.after(steps, episodes), restored.after(steps, episodes)
    assert restored == original


def test_promotion_needs_a_full_window_at_the_rate() -> None:
    now = curriculum().after(10, [("T1", True)] * 4)
    assert now.stage == 0
    assert now.after(10, [("T1", False)]).stage == 1  # 4 of 5 is 0.8
    assert now.after(10, [("T1", False)] * 2).stage == 0


def test_only_the_stage_s_own_domain_counts() -> None:
    second = curriculum().after(10, [("T1", True)] * 5)
    assert second.name == "T2"
    assert second.after(10, [("T1", True)] * 20).stage == 1


def test_the_step_cap_ends_a_stage_but_not_the_last() -> None:
    now = curriculum()
    for stage in (1, 2, 2, 2):
        now = now.after(1000, [])
        assert now.stage == stage


def test_a_state_of_other_stages_is_refused() -> None:
    with pytest.raises(ValueError, match="T1 -> T2 -> T3"):
        Curriculum(("T1",)).restored(curriculum().state())


@pytest.mark.parametrize(
    "settings", [{"promote_at": 0.0}, {"promote_at": 1.1}, {"rehearsal": 1.0}, {"window": 0}, {"max_stage_steps": 0}]
)
def test_settings_out_of_range_are_refused(settings: dict) -> None:
    with pytest.raises(ValueError, match="curriculum"):
        curriculum(**settings)
