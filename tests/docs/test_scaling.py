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
from round_cost import MOVES, Costs, Setup, enough, most, round_of
from round_parts import line
from scaling_picture import draw_scaling

from freemesh_ray.formatting.table import markdown

#: Round numbers, so that every part of a round can be told by hand.
COSTS = Costs(
    step_call=1e-3, step_env=1e-4, latency=2e-3, call=1e-3, byte=1e-8, add_row=1e-6, draw_row=1e-6,
    update_call=2e-3, update_row=1e-5, reduce=5e-4, publish_once=4e-3, publish_runner=2e-3,
    transition_bytes=100, weights_bytes=1000,
)  # fmt: skip
SECONDS = [field.name for field in fields(Costs) if not field.name.endswith("bytes")]

small = st.floats(1e-7, 1e-2)
costs_of_any_size = st.builds(
    Costs, **dict.fromkeys(SECONDS, small), transition_bytes=st.integers(1, 10**4), weights_bytes=st.integers(1, 10**6)
)
setups = st.builds(
    Setup,
    runners=st.integers(1, 2000),
    envs=st.integers(1, 256),
    fragment=st.integers(1, 512),
    updates_per_step=st.floats(1e-3, 4),
    batch=st.integers(1, 1 << 16),
    learners=st.integers(0, 16),
    cores=st.none() | st.integers(1, 64),
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
            "publish": 4e-3 + 2 * 2e-3,
        }
    )
    assert told.bottleneck == "update"


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


@given(costs_of_any_size, setups)
def test_a_round_is_the_sum_of_its_parts_and_its_rates_agree(costs: Costs, setup: Setup) -> None:
    told = round_of(costs, setup)
    assert told.seconds == pytest.approx(sum(told.parts.values()))
    assert sum(told.share(part) for part in told.parts) == pytest.approx(1.0)
    assert told.updates_per_second == pytest.approx(told.samples_per_second * setup.updates_per_step)
    assert told.parts[told.bottleneck] == max(told.parts.values())
    assert set(told.parts) == set(MOVES)
    assert all(seconds > 0 for seconds in told.parts.values())


@given(costs_of_any_size, setups, st.sampled_from(SECONDS), st.floats(1.0, 10.0))
def test_no_part_that_gets_dearer_makes_a_round_shorter(costs: Costs, setup: Setup, part: str, factor: float) -> None:
    dearer = replace(costs, **{part: factor * getattr(costs, part)})
    assert round_of(dearer, setup).seconds >= round_of(costs, setup).seconds * (1 - 1e-12)


@given(costs_of_any_size, setups)
def test_the_unit_of_time_does_not_matter(costs: Costs, setup: Setup) -> None:
    in_milliseconds = replace(costs, **{name: 1e3 * getattr(costs, name) for name in SECONDS})
    assert round_of(in_milliseconds, setup).seconds == pytest.approx(1e3 * round_of(costs, setup).seconds)
    assert most(in_milliseconds, setup) == pytest.approx(most(costs, setup) / 1e3, rel=1e-6)
    assert enough(in_milliseconds, setup) == pytest.approx(enough(costs, setup), rel=1e-3)


@given(costs_of_any_size, setups)
def test_more_runners_sample_more_but_never_beyond_the_limit(costs: Costs, setup: Setup) -> None:
    speeds = [
        round_of(costs, replace(setup, runners=runners, cores=None)).samples_per_second
        for runners in (1, 2, 8, 64, 1024, 10**6)
    ]
    assert all(fewer <= more * (1 + 1e-9) for fewer, more in zip(speeds[:-1], speeds[1:], strict=True))
    assert speeds[-1] <= most(costs, setup) * (1 + 1e-6)


@given(st.floats(0.05, 0.95))
def test_enough_runners_reach_their_share_of_the_limit(share: float) -> None:
    setup = Setup(1, envs=4, fragment=1, updates_per_step=0.001)
    runners = enough(COSTS, setup, share)
    for count, below in ((int(runners), True), (int(runners) + 1, False)):
        reached = round_of(COSTS, replace(setup, runners=count)).samples_per_second / most(COSTS, setup)
        assert reached <= share * (1 + 1e-9) or count == 1 if below else reached >= share * (1 - 1e-9)


def test_a_line_through_two_measurements_never_falls() -> None:
    assert line((1.0, 5.0), (3.0, 9.0)) == pytest.approx((3.0, 2.0))
    assert line((1.0, 5.0), (3.0, 4.0)) == (5.0, 0.0)
    assert line((1.0, 1.0), (2.0, 9.0)) == (0.0, 8.0)


@pytest.fixture(scope="module")
def found() -> dict[str, object]:
    """As a measurement of a machine that behaves as the model says, but for one training that was given up."""
    here = Setup(1, cores=2)
    measured = []
    for learners in scaling.LEARNERS:
        for runners in scaling.RUNNERS:
            told = round_of(COSTS, replace(here, runners=runners, learners=learners, cores=scaling.os.cpu_count()))
            measured.append(scaling.Measured(runners, learners, told.samples_per_second, told.updates_per_second))
    reached = [scaling.Reached(1, 61.3, 24_000, 12_000), scaling.Reached(2, None, 9_000, 4_500)]
    return scaling.summary(COSTS, measured, reached, -15.0, 5.0)


def test_what_is_found_is_written_in_words_tables_and_a_picture(found: dict[str, object], tmp_path: Path) -> None:
    read = json.loads(json.dumps(found))
    assert read["costs"] == asdict(COSTS)
    text = scaling_report.text(read)
    assert text == scaling_report.text(found)
    assert markdown(["runners", "seconds", "env steps", "updates"],
                    [["1", "61", "24,000", "12,000"], ["2", "not in 180", "9,000", "4,500"]]) in text  # fmt: skip
    assert MOVES["update"] in text
    assert "{" not in text
    ratios = [one["modelled_samples_per_second"] / one["samples_per_second"] for one in read["rounds"]]
    assert ratios == pytest.approx([1.0] * len(ratios))
    draw_scaling(*scaling_report.curves(read), tmp_path / "scaling.png")
    assert (tmp_path / "scaling.png").stat().st_size > 10_000


def test_curves_hold_what_was_found(found: dict[str, object]) -> None:
    here, beyond = scaling_report.curves(found)
    assert [len(measured) for measured, _ in here.values()] == [len(scaling.RUNNERS)] * len(scaling.LEARNERS)
    assert set(beyond) == set(scaling.VARIANTS)
    for one in found["far"]:  # type: ignore[attr-defined]
        below = [speed for runners, speed in beyond[one["settings"]] if runners <= one["runners"]]
        assert max(below) <= one["samples_per_second"] * (1 + 1e-9) <= one["most_samples_per_second"] * (1 + 1e-6)


def test_the_page_is_what_its_numbers_say() -> None:
    found = json.loads((ROOT / "docs/scaling.json").read_text())
    assert (ROOT / "docs/scaling.md").read_text() == scaling_report.text(found)
