"""The model of a training round's cost: sums, limits and units, on parts whose answer is known; and what is written."""

from __future__ import annotations

import json
from dataclasses import asdict, fields, replace
from pathlib import Path

import pytest
import scaling
import scaling_report
from checkout import ROOT
from hypothesis import given
from hypothesis import strategies as st
from round_cost import MOVES, Costs, Setup, enough, hides, most, round_of
from round_parts import line
from scaling_picture import draw_scaling

from freemesh_ray.formatting.table import markdown

#: Round numbers, so that every part of a round can be told by hand.
COSTS = Costs(
    step_call=1e-3, step_env=1e-4, latency=2e-3, call=1e-3, byte=1e-8, add_row=1e-6, draw_row=1e-6,
    update_call=2e-3, update_row=1e-5, reduce=5e-4, publish_once=4e-3, publish_runner=2e-3,
    send_once=2e-3, send_runner=5e-4, publish_local=3e-4, transition_bytes=100, weights_bytes=1000,
)  # fmt: skip
SECONDS = [field.name for field in fields(Costs) if not field.name.endswith("bytes")]

small = st.floats(1e-7, 1e-2)
costs_of_any_size = st.builds(
    Costs, **dict.fromkeys(SECONDS, small), transition_bytes=st.integers(1, 10**4), weights_bytes=st.integers(1, 10**6)
)
setups = st.builds(
    Setup,
    runners=st.integers(0, 2000),
    envs=st.integers(1, 256),
    fragment=st.integers(1, 512),
    updates_per_step=st.floats(1e-3, 4),
    batch=st.integers(1, 1 << 16),
    learners=st.integers(0, 16),
    cores=st.none() | st.integers(1, 64),
    overlap=st.booleans(),
)


def test_the_parts_of_a_round_by_hand() -> None:
    """Two runners of ten environments, five steps: 100 env steps, and 50 updates."""
    told = round_of(COSTS, Setup(2, 10, 5, 0.5, 100))
    assert (told.steps, told.updates) == (100, 50)
    assert told.parts == pytest.approx(
        {
            "sampling": 5 * (1e-3 + 10 * 1e-4),
            "transport": 2e-3 + 2 * 1e-3 + 100 * 100 * 1e-8,
            "replay": 100 * 1e-6 + 50 * 100 * 1e-6,
            "update": 50 * (2e-3 + 100 * 1e-5),
            "publish": 2e-3 + 2 * 5e-4,
        }
    )
    assert told.seconds == pytest.approx(0.0041 + 0.0051 + 0.150 + 0.003)
    assert told.waited["sampling"] == 0
    assert (told.behind, told.bottleneck) == (("sampling", "update"), "update")
    assert told.hidden == pytest.approx(1)


def test_without_overlap_a_round_is_the_sum_and_publishing_waits() -> None:
    told = round_of(COSTS, Setup(2, 10, 5, 0.5, 100, overlap=False))
    assert told.parts["publish"] == pytest.approx(4e-3 + 2 * 2e-3)
    assert told.seconds == pytest.approx(0.010 + 0.0041 + 0.0051 + 0.150 + 0.008)
    assert told.waited == pytest.approx(told.parts)
    assert told.hidden == pytest.approx(0)


def test_without_runners_the_training_samples_itself() -> None:
    told = round_of(COSTS, Setup(0, 10, 5, 0.5, 100))
    assert (told.steps, told.updates) == (50, 25)
    assert told.parts == pytest.approx(
        {"sampling": 0.010, "transport": 0, "replay": 50e-6 + 2500e-6, "update": 25 * 3e-3, "publish": 3e-4}
    )
    assert told.seconds == pytest.approx(sum(told.parts.values()))
    assert told == round_of(COSTS, Setup(0, 10, 5, 0.5, 100, overlap=False))


def test_updates_are_hidden_behind_longer_sampling() -> None:
    """200 environment steps with 0.01 updates for each: two updates of 3 ms, while one runner samples for 40 ms."""
    told = round_of(COSTS, Setup(1, 10, 20, 0.01, 100))
    assert (told.behind, told.bottleneck) == (("update", "sampling"), "sampling")
    assert told.hidden == pytest.approx(1)
    assert told.waited["update"] == 0
    assert told.waited["sampling"] == pytest.approx(0.040)


def test_learners_share_the_rows_and_pay_for_the_way() -> None:
    alone, one, two = (round_of(COSTS, Setup(2, 10, 5, 0.5, 100, learners)).parts for learners in (0, 1, 2))
    way = 2e-3 + 50 * 100 * 100 * 1e-8
    assert one["update"] == pytest.approx(alone["update"] + way)
    assert two["update"] == pytest.approx(50 * (2e-3 + 50 * 1e-5) + way + 50 * 5e-4)
    assert {part: alone[part] for part in alone if part != "update"} == {
        part: two[part] for part in two if part != "update"
    }


def test_processes_on_too_few_cores_wait_for_each_other() -> None:
    free = Setup(8, learners=4)
    crowded = round_of(COSTS, replace(free, cores=2)).parts
    assert crowded["sampling"] == pytest.approx(4 * round_of(COSTS, free).parts["sampling"])
    assert crowded["update"] > 1.5 * round_of(COSTS, free).parts["update"]
    assert round_of(COSTS, replace(free, cores=64)) == round_of(COSTS, free)


@pytest.mark.parametrize(("cores", "together", "hidden"), [(1, 0.170, 0.0), (2, 0.150, 1.0)])
def test_work_that_shares_cores_is_hidden_as_far_as_they_last(cores: int, together: float, hidden: float) -> None:
    """Two runners sample for 10 ms each, 20 ms where they share a core, while the learner updates for 150 ms."""
    told = round_of(COSTS, Setup(2, 10, 5, 0.5, 100, cores=cores))
    assert told.together == pytest.approx(together)
    assert told.hidden == pytest.approx(hidden)
    assert told.waited["sampling"] == pytest.approx(together - 0.150, abs=1e-12)


def test_work_of_three_processes_takes_no_less_than_two_cores_can_do() -> None:
    """Two runners sample for 40 ms each while the learner updates for 30 ms: 110 ms of work, 15 ms hidden of 30."""
    told = round_of(COSTS, Setup(2, 10, 20, 0.025, 100, cores=2))
    assert (told.parts["sampling"], told.parts["update"]) == pytest.approx((0.040, 0.030))
    assert (told.together, told.hidden) == pytest.approx((0.055, 0.5))


@given(costs_of_any_size, setups)
def test_a_round_waits_for_its_parts_but_for_what_is_hidden_and_its_rates_agree(costs: Costs, setup: Setup) -> None:
    told = round_of(costs, setup)
    shorter, longer = told.behind
    assert told.parts[shorter] <= told.parts[longer]
    assert told.seconds == pytest.approx(sum(told.parts.values()) - told.hidden * told.parts[shorter])
    assert sum(told.share(part) for part in told.parts) == pytest.approx(1.0)
    assert told.updates_per_second == pytest.approx(told.samples_per_second * setup.updates_per_step)
    assert told.waited[told.bottleneck] == max(told.waited.values())
    assert set(told.parts) == set(MOVES)
    assert all(seconds > 0 or (part == "transport" and not setup.runners) for part, seconds in told.parts.items())


@given(costs_of_any_size, setups)
def test_overlap_hides_all_of_the_shorter_where_cores_last_and_never_costs(costs: Costs, setup: Setup) -> None:
    costs = replace(costs, send_once=costs.publish_once, send_runner=costs.publish_runner)
    with_, without = (round_of(costs, replace(setup, overlap=overlap)) for overlap in (True, False))
    assert with_.parts == without.parts
    assert without.hidden == pytest.approx(0, abs=1e-3)  # of a part far shorter than the other
    assert max(with_.parts.values()) <= with_.seconds * (1 + 1e-9) <= without.seconds * (1 + 2e-9)
    processes = setup.runners + max(1, setup.learners)
    if setup.runners and (setup.cores is None or setup.cores >= processes):
        assert with_.hidden == pytest.approx(1.0, abs=1e-3)
    if setup.runners and setup.cores == 1 and setup.learners == 0:
        assert with_.seconds == pytest.approx(without.seconds)


@given(costs_of_any_size, setups, st.sampled_from(SECONDS), st.floats(1.0, 10.0))
def test_no_part_that_gets_dearer_makes_a_round_shorter(costs: Costs, setup: Setup, part: str, factor: float) -> None:
    dearer = replace(costs, **{part: factor * getattr(costs, part)})
    assert round_of(dearer, setup).seconds >= round_of(costs, setup).seconds * (1 - 1e-12)


@given(costs_of_any_size, setups)
def test_the_unit_of_time_does_not_matter(costs: Costs, setup: Setup) -> None:
    in_milliseconds = replace(costs, **{name: 1e3 * getattr(costs, name) for name in SECONDS})
    assert round_of(in_milliseconds, setup).seconds == pytest.approx(1e3 * round_of(costs, setup).seconds)
    assert most(in_milliseconds, setup) == pytest.approx(most(costs, setup) / 1e3, rel=1e-6)
    assert enough(in_milliseconds, setup) == pytest.approx(enough(costs, setup), rel=1e-3, abs=1)
    assert hides(in_milliseconds, setup) == pytest.approx(hides(costs, setup))


@given(costs_of_any_size, setups)
def test_more_runners_sample_more_but_never_beyond_the_limit(costs: Costs, setup: Setup) -> None:
    speeds = [
        round_of(costs, replace(setup, runners=runners, cores=None)).samples_per_second
        for runners in (1, 2, 8, 64, 1024, 10**6)
    ]
    assert all(fewer <= more * (1 + 1e-9) for fewer, more in zip(speeds[:-1], speeds[1:], strict=True))
    assert speeds[-1] <= most(costs, setup) * (1 + 1e-6)


def test_the_limit_by_hand() -> None:
    """A runner's 50 steps cost 1.05 ms to bring, 2.55 ms to store and draw, 75 ms to learn and 0.5 ms to send to."""
    setup = Setup(1, 10, 5, 0.5, 100)
    assert most(COSTS, setup) == pytest.approx(50 / (1.05e-3 + 2.55e-3 + 75e-3 + 0.5e-3))
    waiting = replace(setup, overlap=False)
    assert most(COSTS, waiting) == pytest.approx(50 / (1.05e-3 + 2.55e-3 + 75e-3 + 2e-3))


@given(costs_of_any_size, setups, st.floats(0.05, 0.95))
def test_enough_runners_reach_their_share_of_the_limit_and_fewer_do_not(
    costs: Costs, setup: Setup, share: float
) -> None:
    runners, limit = enough(costs, setup, share), share * most(costs, setup)
    assert runners >= 1
    for count in {runners, max(1, runners - 1)}:
        reached = round_of(costs, replace(setup, runners=count, cores=None)).samples_per_second
        assert (reached >= limit) == (count == runners)


@given(costs_of_any_size, setups)
def test_one_runner_is_hidden_behind_the_updates_from_where_it_is_said(costs: Costs, setup: Setup) -> None:
    alone = replace(setup, runners=1, learners=0, cores=None, overlap=True)
    for factor, shorter in ((1.001, "sampling"), (0.999, "update")):
        told = round_of(costs, replace(alone, updates_per_step=factor * hides(costs, alone)))
        assert told.behind[0] == shorter


def test_a_line_through_two_measurements_never_falls() -> None:
    assert line((1.0, 5.0), (3.0, 9.0)) == pytest.approx((3.0, 2.0))
    assert line((1.0, 5.0), (3.0, 4.0)) == (5.0, 0.0)
    assert line((1.0, 1.0), (2.0, 9.0)) == (0.0, 8.0)


@pytest.mark.parametrize(
    ("cores", "runners"), [(1, [0, 1, 2]), (2, [0, 1, 2]), (7, [0, 1, 2, 4]), (8, [0, 1, 2, 4, 8])]
)
def test_runners_are_measured_while_cores_last(cores: int, runners: list[int]) -> None:
    assert scaling.counts(cores) == runners


@given(st.integers(1, 256), st.integers(0, 255))
def test_what_is_measured_has_what_auto_chooses_beside_its_alternatives(cores: int, auto: int) -> None:
    planned = scaling.cases(cores, dict.fromkeys(scaling.RATIOS, auto))
    assert len(set(planned)) == len(planned)
    for ratio in scaling.RATIOS:
        for runners in {0, 1, 2, auto}:
            assert scaling.Case(runners, updates_per_step=ratio) in planned
        for runners in (1, 2):
            assert scaling.Case(runners, updates_per_step=ratio, overlap=False) in planned
    assert {case.learners for case in planned} == {0, *scaling.LEARNERS}


@pytest.fixture(scope="module")
def found() -> dict[str, object]:
    """As a measurement of a machine that behaves as the model says, but for one training that was given up."""
    auto, here = dict.fromkeys(scaling.RATIOS, 1), Setup(1, cores=2)
    measured = []
    for case in scaling.cases(2, auto):
        told = round_of(COSTS, replace(here, **asdict(case)))
        measured.append(scaling.Measured(case, told.samples_per_second, told.updates_per_second))
    reached = [scaling.Reached(0, 61.3, 24_000, 12_000), scaling.Reached(1, None, 9_000, 4_500)]
    return scaling.summary(COSTS, measured, reached, auto, wanted=-15.0, seconds=5.0, cores=2)


def test_what_is_found_is_written_in_words_tables_and_a_picture(found: dict[str, object], tmp_path: Path) -> None:
    read = json.loads(json.dumps(found))
    assert read["costs"] == asdict(COSTS)
    text = scaling_report.text(read)
    assert text == scaling_report.text(found)
    assert markdown(["runners", "seconds", "env steps", "updates"],
                    [["0", "61", "24,000", "12,000"], ["1", "not in 90", "9,000", "4,500"]]) in text  # fmt: skip
    assert MOVES["update"] in text
    # By hand: 8 steps of 1 ms + 16 x 0.1 ms; 2 + 1 ms and 128 x 100 bytes, 2.5 ms of weights in place of 0.3 ms.
    told = " ".join(text.split())
    assert "spares the training's process 21 ms of sampling a round, and costs it 5.3 ms more" in told
    assert "{" not in text
    ratios = [one["model"]["samples_per_second"] / one["samples_per_second"] for one in read["rounds"]]
    assert ratios == pytest.approx([1.0] * len(ratios))
    figure = draw_scaling(*scaling_report.curves(read), tmp_path / "scaling.png")
    labels = [label.get_text() for axes in figure.axes for label in (*axes.get_xticklabels(), *axes.get_yticklabels())]
    assert "1,000" in labels
    assert not any("$" in label for label in labels)
    assert (tmp_path / "scaling.png").stat().st_size > 10_000


def test_lines_beside_learning_say_what_they_are_compared_with(found: dict[str, object]) -> None:
    """Samples a second as below, for half an update a step; others are far away."""
    speeds = {(0, True): 80.0, (1, True): 99.0, (1, False): 90.0, (2, True): 110.0, (2, False): 95.0}
    rounds = [
        {**one, "samples_per_second": speeds[one["runners"], one["overlap"]] if here else 1e6}
        for one in found["rounds"]  # type: ignore[attr-defined]
        for here in [one["updates_per_step"] == 0.5 and one["learners"] == 0]
    ]
    lines = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in scaling_report.beside({**found, "rounds": rounds}).splitlines()[2:]
    ]
    assert len(lines) == 15
    assert [line[:4] + line[5:7] for line in lines[:5]] == [
        ["1/2", "0", "-", "80", "73%", "-"],
        ["1/2", "1 (auto)", "yes", "99", "90%", "1.24"],
        ["1/2", "1", "no", "90", "82%", "-"],
        ["1/2", "2", "yes", "110", "100%", "1.11"],
        ["1/2", "2", "no", "95", "86%", "-"],
    ]
    assert "`auto` has 90% of the fastest's" in scaling_report.text({**found, "rounds": rounds})


def test_what_is_hidden_is_told_with_what_hides_it(found: dict[str, object]) -> None:
    model = {"behind": ["sampling", "update"], "hidden": 0.254}
    assert scaling_report.hidden(model) == "25% of sampling behind update"
    assert scaling_report.hidden({**model, "hidden": 0.0}) == "-"
    by_overlap = {
        (one["runners"] > 0 and one["overlap"]): one["model"]["hidden"] > 0
        for one in found["rounds"]  # type: ignore[attr-defined]
    }
    assert by_overlap == {True: True, False: False}


def test_curves_hold_what_was_found(found: dict[str, object]) -> None:
    here, beyond = scaling_report.curves(found)
    assert set(here) == {"1/2 updates a step", "1/16 updates a step", "1/256 updates a step"}
    for overlapping, waiting, modelled in here.values():
        assert [runners for runners, _ in overlapping] == [runners for runners, _ in modelled] == [0, 1, 2]
        assert [runners for runners, _ in waiting] == [1, 2]
    assert set(beyond) == set(scaling.VARIANTS)
    for one in found["far"]:  # type: ignore[attr-defined]
        below = [speed for runners, speed in beyond[one["settings"]] if runners <= one["runners"]]
        assert max(below) <= one["samples_per_second"] * (1 + 1e-9) <= one["most_samples_per_second"] * (1 + 1e-6)


def test_the_page_is_what_its_numbers_say() -> None:
    found = json.loads((ROOT / "docs/scaling.json").read_text())
    assert (ROOT / "docs/scaling.md").read_text() == scaling_report.text(found)
    assert found["hides"] <= found["enough"] == scaling.ENOUGH
