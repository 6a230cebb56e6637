"""A study's report: what is read, what is said, and that every picture's numbers are in the CSV files."""

from __future__ import annotations

import csv
import json
import math
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from envs.errors import BAD_INPUT
from freemesh_ray.cli import command
from freemesh_ray.config import ConfigError
from freemesh_ray.paper_tables.density import density
from freemesh_ray.plots import Pair, Panel, draw_bands, draw_improvements, draw_settings
from freemesh_ray.policies.evaluation import COMPLETION, RETURN
from freemesh_ray.report import pictures
from freemesh_ray.report.against_paper import median_seed, paper_table
from freemesh_ray.report.machine import machine, model
from freemesh_ray.report.one_study import write
from freemesh_ray.report.outcomes import Evidence, evidence, judged
from freemesh_ray.report.ranked_draws import Ranked, nothing_completed, ranking
from freemesh_ray.report.results import TrialResult, read
from freemesh_ray.report.transfer import Transfer, transfer
from freemesh_ray.report.variants import return_threshold, variant_results
from freemesh_ray.statistics.aligned_curves import final_value
from freemesh_ray.statistics.bootstrap import Interval
from freemesh_ray.statistics.permutation import p_value
from freemesh_ray.statistics.verdict import Verdict
from freemesh_ray.storage.atomic import OutputError
from freemesh_ray.studies.definition import Expectation
from freemesh_ray.studies.study_folder import StudyError
from tests.recorded_study import SEEDS, algorithms, rows, write_run, write_study

SQUARE = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]
NOTHING = Transfer([], {}, {}, {})


@pytest.fixture(scope="module")
def square(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A domain that random weights complete now and then."""
    path = tmp_path_factory.mktemp("domains") / "square.json"
    path.write_text(json.dumps(SQUARE))
    return str(path)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, square: str) -> Path:
    """A finished study with its report, of four variants and three seeds: two expectations and an equality."""
    folder = tmp_path_factory.mktemp("studies") / "algorithms"
    algorithms(folder, domains=[square, "nowhere.json"], expects=["SAC > PPO", "DDPG > TD3", "SAC = DDPG"])
    write(folder, docs=folder.parent / "docs", episodes=2)
    return folder


def lines(path: Path) -> list[dict[str, str]]:
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def cells(text: str, first: str) -> list[list[str]]:
    """The cells of the table lines that begin with ``first``."""
    found = [line for line in text.splitlines() if re.match(rf"\| {re.escape(first)} *\|", line)]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in found]


def change(folder: Path, place: int, **entries: object) -> None:
    """Change one trial of a study."""
    path = folder / "trials.json"
    trials = json.loads(path.read_text())
    trials[place] |= entries
    path.write_text(json.dumps(trials))


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Two variants, three seeds, nothing to evaluate on."""
    return algorithms(tmp_path / "studies" / "small", {"A": (60.0, 30e3), "B": (10.0, 30e3)}, domains=[],
                      expects=["A > B"])  # fmt: skip


# ---- a finished study ------------------------------------------------------------------------------------------------


def test_a_report_says_what_the_paper_says_and_what_came_out(finished: Path):
    text = (finished / "report" / "report.md").read_text()
    assert text.startswith("# Learning efficiency of four algorithms\n")
    assert "Its finding:** SAC learns fastest" in text
    assert "Not finished" not in text
    assert cells(text, "SAC > PPO")[0][-3:] == ["0.0500", "0.100", "**separated**; needs about 4 seeds each"]
    assert cells(text, "DDPG > TD3")[0][-1].startswith("**separated against it**; needs about ")
    equality = cells(text, "SAC = DDPG")[0]
    assert equality[-1].startswith("**separated against it**; needs about ")
    assert [cell[0] for cell in equality[2:4]] == ["+", "+"]
    assert "1 separated, 2 separated against it." in text
    assert "by Holm over the 3 expectations of this report" in text
    assert "budget 200,000 env steps a trial, shorter than the paper's 1,200,000" in text
    assert "commit 0123456789" in text
    assert "nowhere.json: " in text


@pytest.mark.slow
def test_a_study_of_one_s_own_is_not_said_to_be_the_paper_s(small: Path):
    text = write(small).read_text()
    assert "## What the paper expects" in text
    path = small / "study.yaml"
    tree = yaml.safe_load(path.read_text())
    del tree["study"]["paper"]
    path.write_text(yaml.safe_dump(tree))
    text = write(small).read_text()
    assert "## What was expected" in text
    assert "paper" not in text


def test_every_picture_is_there_in_both_formats_and_is_linked(finished: Path):
    for folder, text in ((finished / "report", "report.md"), (finished.parent / "docs" / "algorithms", "README.md")):
        linked = re.findall(r"!\[.+\]\((.+\.png)\)", (folder / text).read_text())
        assert len(linked) == 3
        for name in linked:
            assert (folder / name).read_bytes().startswith(b"\x89PNG")
    for name in ("curves", "profile", "improvement"):
        assert (finished / "report" / f"{name}.svg").read_bytes().startswith(b"<?xml")


def test_the_docs_are_the_report_with_its_numbers_and_records(finished: Path):
    docs, report = finished.parent / "docs" / "algorithms", finished / "report"
    assert (docs / "README.md").read_text() == (report / "report.md").read_text()
    others = {file.name for file in report.iterdir()} - {"report.md", "report.html", "curves.svg", "profile.svg",
                                                         "improvement.svg"}  # fmt: skip
    assert {file.name for file in docs.iterdir()} == {"README.md", *others}
    assert {"records.parquet", "curves.csv", "domains.csv", "mesh-1-1.svg"} <= others
    for name in others:
        assert (docs / name).read_bytes() == (report / name).read_bytes()


def test_the_table_holds_the_numbers_of_the_csv(finished: Path):
    text = (finished / "report" / "report.md").read_text()
    own = [line for line in lines(finished / "report" / "final.csv") if line["variant"] == "SAC"]
    assert [line["seed"] for line in own] == [str(seed) for seed in SEEDS]
    returns = np.array([float(line[RETURN]) for line in own])
    row = next(row for row in cells(text, "SAC") if row[1] == "3 of 3")
    assert row[2] == f"{returns.mean():.1f} ± {returns.std(ddof=1):.1f}"
    middle = np.sort(returns) @ [1 / 6, 4 / 6, 1 / 6]
    assert row[3].startswith(f"{middle:.1f} [")


def test_a_final_figure_is_the_mean_over_the_last_tenth_of_the_training(finished: Path):
    results = read(finished)
    first = lines(finished / "report" / "final.csv")[0]
    steps, returns = results.trials[0].curve(RETURN)
    assert float(first[RETURN]) == pytest.approx(final_value(steps, returns))
    assert float(first[RETURN]) == pytest.approx(returns[-3:].mean())  # of 20, the first of them at 90 %


def test_curves_lie_in_their_bands(finished: Path):
    results = read(finished)
    drawn = lines(finished / "report" / "curves.csv")
    assert {line["variant"] for line in drawn} == set(results.labels)
    for label in results.labels:
        own = [line for line in drawn if line["variant"] == label and line["figure"] == RETURN]
        steps = np.array([float(line["env_steps"]) for line in own])
        seeds = [trial.curve(RETURN) for trial in results.of(label)]
        assert steps[0] == max(x[0] for x, _ in seeds)
        assert steps[-1] == min(x[-1] for x, _ in seeds)
        low, value, high = (np.array([float(line[key]) for line in own]) for key in ("low", "iqm", "high"))
        assert (low < value).all()
        assert (value < high).all()
        rates = [line for line in drawn if line["variant"] == label and line["figure"] == COMPLETION]
        assert all(0.0 <= float(line["low"]) <= float(line["high"]) <= 1.0 for line in rates)


def test_scores_are_of_every_policy_on_every_domain_that_loads(finished: Path):
    found = lines(finished / "report" / "domains.csv")
    assert len(found) == 4 * 3 * 1 * 2
    for line in found:
        assert 0.0 <= float(line["score"]) <= float(line["completion_rate"])
        assert line["domain"] == "square"
    profile = lines(finished / "report" / "profile.csv")
    assert all(0 <= float(line["low"]) <= float(line["share_above"]) <= float(line["high"]) <= 1 for line in profile)


def test_pairs_are_all_compared_the_better_first(finished: Path):
    found = lines(finished / "report" / "comparisons.csv")
    assert len(found) == 6
    assert all(float(line["by_final"]) >= 0.5 for line in found)
    assert all(float(line["p_value"]) <= float(line["p_corrected"]) for line in found)
    clear = [float(line["p_corrected"]) for line in found if line["by_final"] == "1.0"]
    assert clear == pytest.approx([0.6] * len(clear))  # six pairs, a tenth each
    assert all(float(line["by_score_low"]) <= float(line["by_score"]) <= float(line["by_score_high"]) for line in found)


def test_every_expectation_has_its_numbers(finished: Path):
    found = lines(finished / "report" / "expectations.csv")
    assert [line["expected"] for line in found] == ["SAC > PPO", "DDPG > TD3", "SAC = DDPG"]
    assert [line["verdict"] for line in found] == ["separated", "separated against it", "separated against it"]
    for line in found:
        assert float(line["difference_low"]) <= float(line["difference"]) <= float(line["difference_high"])
        assert float(line["p_value"]) < float(line["p_corrected"])


@pytest.mark.slow
def test_of_many_pairs_those_of_the_best_variant_are_shown(tmp_path: Path):
    ends = {f"V{i}": (10.0 * i, 3e4) for i in range(1, 8)}
    text = write(algorithms(tmp_path / "many", ends, SEEDS[:2], domains=[])).read_text()
    shown = re.findall(r"^\| (V\d) > (V\d) ", text, re.MULTILINE)
    assert [x for x, _ in shown] == ["V7"] * 6
    assert "All 21 pairs are in comparisons.csv." in text
    assert len(lines(tmp_path / "many" / "report" / "comparisons.csv")) == 21


@pytest.mark.slow
def test_the_same_study_gives_the_same_report(finished: Path, tmp_path: Path):
    write(finished, out=tmp_path, episodes=2)
    for file in tmp_path.iterdir():
        assert file.read_bytes() == (finished / "report" / file.name).read_bytes(), file.name


# ---- an unfinished one -----------------------------------------------------------------------------------------------


def test_failed_trials_are_counted_told_and_left_out(small: Path):
    change(small, 1, status="failed", error="ValueError: action 3 | is\nnot finite")
    text = write(small).read_text()
    assert "Of 6 trials: 1 failed, left out of all figures (see Trials)." in text
    assert "Figures are of finished trials" in text
    assert "- A, seed 567: ValueError: action 3 \\| is not finite" in text
    assert next(row for row in cells(text, "A") if "of" in row[1])[1] == "2 of 3"
    assert cells(text, "A > B")[0][-1].startswith("**separated**")  # two seeds against three can confirm nothing


def test_no_verdict_while_trials_are_under_way(small: Path):
    change(small, 4, status="running")
    text = write(small).read_text()
    assert "**Not finished yet:** of 6 trials 5 finished, 1 running." in text
    assert cells(text, "A > B")[0][-1] == "**undecided**"


def test_a_variant_without_a_finished_trial_is_provisional(small: Path):
    for place in (3, 4, 5):
        change(small, place, status="stopped")
    text = write(small).read_text()
    assert [row for row in cells(text, "B*") if row[1] == "3 of 3"]
    assert "3 stopped" in text


def test_before_the_first_evaluation_there_is_nothing_to_say_and_it_is_said(small: Path):
    for place in range(6):
        change(small, place, status="pending")
    shutil.rmtree(small / "runs")
    text = write(small).read_text()
    assert "6 pending" in text
    assert "no evaluation yet" in cells(text, "A > B")[0][-1]
    assert next(row for row in cells(text, "A") if row[1] == "0 of 3")[2:5] == ["-", "-", "-"]
    assert not lines(small / "report" / "curves.csv")


def test_one_seed_has_no_interval(tmp_path: Path):
    folder = algorithms(tmp_path / "one", {"A": (60.0, 30e3), "B": (10.0, 30e3)}, [5], domains=[], expects=["A > B"])
    text = write(folder).read_text()
    assert "(one seed has none)" in text
    assert "## Pair by pair" not in text
    assert cells(text, "A > B")[0][-1] == "**undecided**"
    own = [line for line in lines(folder / "report" / "curves.csv") if line["variant"] == "A"]
    assert all(line["low"] == line["iqm"] == line["high"] for line in own)


def test_evaluations_cut_short_by_a_kill_and_a_policy_that_is_missing(small: Path, square: str):
    run = small / "runs" / "A-356"
    with open(run / "evaluations.jsonl", "a") as file:
        file.write('{"env_steps": 2100')
    (run / "policy.npz").unlink()
    results = read(small)
    assert len(results.trials[0].evaluations) == 20
    found = transfer(results.trials, [square], 1)
    assert list(found.policies) == [(trial.label, trial.seed) for trial in results.trials[1:]]
    assert "no such policy" in found.skipped["A, seed 356"]
    assert found.of("A", "score", "stochastic").shape == (2, 1)


# ---- figures ---------------------------------------------------------------------------------------------------------


def test_the_threshold_is_half_the_best_or_midway_to_it(small: Path):
    variants = variant_results(read(small))
    best = max(float(variant.final_return.value) for variant in variants)
    first = np.mean([trial.curve(RETURN)[1][0] for variant in variants for trial in variant.used])
    assert return_threshold(variants) == pytest.approx(0.5 * (best if best > 0 else first + best))
    curve, each = variants[0].steps_to(return_threshold(variants))
    assert curve is not None
    assert min(step for step in each if step) <= curve <= max(step for step in each if step)
    assert math.isnan(return_threshold([]))


def test_steps_and_time_to_a_completion_rate_are_medians_with_how_many_reach_it(small: Path):
    variants = {variant.label: variant for variant in variant_results(read(small))}
    found = variants["A"].to_completion()
    for trial, (steps, seconds) in zip(variants["A"].used, found, strict=True):
        at, rates = trial.curve(COMPLETION)
        first = int(np.flatnonzero(rates >= 0.9)[0])
        assert at[first - 1] < steps <= at[first]
        assert np.interp(steps, at, rates) == pytest.approx(0.9)
        assert seconds == pytest.approx(steps / 300)
    assert variants["B"].to_completion() == [(math.inf, math.inf)] * 3
    text = write(small).read_text()
    steps, seconds = np.median(found, axis=0)
    row = next(row for row in cells(text, "A") if row[1] == "3 of 3")
    assert row[-2:] == [f"{steps / 1000:.0f}k (3 of 3)", f"{seconds / 60:.0f} min"]
    row = next(row for row in cells(text, "B") if row[1] == "3 of 3")
    assert row[-2:] == ["never (0 of 3)", "-"]
    (first, *_, last) = lines(small / "report" / "final.csv")
    assert float(first["steps_to_completion_0.9"]) == found[0][0]
    assert (last["steps_to_completion_0.9"], last["seconds_to_completion_0.9"]) == ("", "")


def test_the_order_of_the_trials_changes_no_figure(small: Path):
    before = variant_results(read(small))
    path = small / "trials.json"
    path.write_text(json.dumps(json.loads(path.read_text())[::-1]))
    for one, other in zip(before, variant_results(read(small)), strict=True):
        assert one.label == other.label
        assert float(one.final_return.value) == pytest.approx(float(other.final_return.value))
        np.testing.assert_allclose(one.bands[RETURN].iqm.value, other.bands[RETURN].iqm.value)


def test_verdicts_follow_the_returns(small: Path):
    results = read(small)
    (outcome,) = judged(evidence(results.study.expects, variant_results(results), NOTHING))
    assert str(outcome.verdict) == "confirmed"
    assert outcome.p_value == outcome.p_corrected == pytest.approx(1 / 20)


def measured(x: np.ndarray, relation: str, y: np.ndarray, complete: bool = True) -> Evidence:
    """Final values of two variants, as if a study had found them."""
    return Evidence(Expectation("X", relation, "Y"), x, y, None, complete)


def test_ten_seeds_against_three_survive_a_correction_over_thirteen():
    many, few = np.arange(10.0) + 10.0, np.arange(3.0)
    other = measured(few, ">", few, complete=False)
    said = judged([measured(many, ">", few), *(12 * [other])])
    assert said[0].p_value == p_value(many, few) == pytest.approx(1 / 286)
    assert said[0].p_corrected == pytest.approx(13 / 286)
    assert [outcome.verdict for outcome in said] == [Verdict.CONFIRMED] + 12 * [Verdict.UNDECIDED]
    assert judged([measured(few, ">", many)])[0].verdict is Verdict.REFUTED
    one_more = judged([measured(many, ">", few), *(14 * [other])])
    assert one_more[0].verdict is Verdict.SEPARATED


def test_equalities_count_only_for_what_refutes():
    x, y, near = np.arange(3.0) + 5.0, np.arange(3.0), 100.0 + np.arange(10.0) / 10.0
    said = judged([measured(x, ">", y), measured(near, "=", near[::-1]), measured(y, ">", x)])
    assert said[0].p_corrected == pytest.approx(2 / 20)  # of two that could be confirmed
    assert said[1].verdict is Verdict.SAME
    assert said[2].p_corrected == pytest.approx(3 / 20)  # of three that could be refuted


def test_what_is_not_finished_counts_and_is_undecided():
    x, y = np.arange(3.0) + 5.0, np.arange(3.0)
    done, waiting = judged([measured(x, ">", y), measured(x, ">", y, complete=False)])
    assert done.p_corrected == pytest.approx(2 / 20)
    assert (waiting.verdict, waiting.seeds, waiting.open) == (Verdict.UNDECIDED, None, False)


# ---- the paper's tables ----------------------------------------------------------------------------------------------


def test_density_is_set_beside_the_papers_figures_with_the_median_seed(tmp_path: Path, monkeypatch):
    sets = {"dense": {"env.upsilon": 0.5}, "medium": {"env.upsilon": 1.0}}
    folder = algorithms(tmp_path / "density", {"dense": (60.0, 3e4), "medium": (50.0, 3e4)}, domains=[], sets=sets)
    asked = {}

    def table(policies, domain, episodes):
        asked.update(policies)
        return density(policies, domain, 1)

    results = read(folder)
    variants = variant_results(results)
    policies = transfer(results.trials, [], 1).policies
    monkeypatch.setattr("freemesh_ray.report.against_paper.density", table)
    text = paper_table(variants, policies)
    assert [made.parameters.upsilon for made in asked.values()] == [0.5, 1.0]
    finals = dict(zip([trial.seed for trial in variants[0].used], variants[0].finals[RETURN], strict=True))
    seed = median_seed(variants[0], policies)
    assert finals[seed] == np.median(list(finals.values()))
    assert f"dense {seed}, medium " in text
    assert cells(text, "dense")[0][1:3] == ["0.5", "0.5"]


def test_other_studies_have_no_table_of_the_paper(small: Path):
    results = read(small)
    assert paper_table(variant_results(results), transfer(results.trials, [], 1).policies) == ""


# ---- a search --------------------------------------------------------------------------------------------------------


def search(folder: Path, default: bool = True, best: float = 50.0, metric: str = RETURN) -> Path:
    """Trials of learning rate and width; the return falls with the distance of the rate from 1e-3."""
    trials = []
    rates = [1e-4, 3e-4 if default else 2e-4, 1e-3, 3e-3, 1e-2]
    for i, rate in enumerate(rates):
        found = np.full(8, best - 10.0 * abs(math.log10(rate) + 3))
        write_run(folder / f"t{i}", rows(10_000 * np.arange(1, 9), found), None, [f"learner.learning_rate={rate}"])
        trials.append({"label": f"t{i}", "seed": 1, "run": f"t{i}", "status": "finished", "error": None,
                       "settings": {"learner.learning_rate": rate, "learner.hidden": [128, 128, 128]}})  # fmt: skip
    trials.append({"label": "t9", "seed": 1, "run": "t9", "status": "failed", "error": "out of memory",
                   "settings": {"learner.learning_rate": 0.1, "learner.hidden": [64]}})  # fmt: skip
    space = {"learner.learning_rate": {"log": [1e-5, 1.0]}, "learner.hidden": {"choice": [[128, 128, 128], [64]]}}
    about = {"title": "Which learning rate", "search": {"trials": 6, "space": space}, "seeds": [1], "metric": metric}
    return write_study(folder, about, trials)


def test_a_search_is_ranked_with_the_defaults_place(tmp_path: Path):
    text = write(search(tmp_path / "rates"), docs=tmp_path / "docs").read_text()
    assert "The best of 5 trials is t2 with a final return of 50. The default is number 3 of 5, with 44.77." in text
    assert "--set learner.learning_rate=0.001 --set 'learner.hidden=[128, 128, 128]'" in text
    assert "t9, seed 1: out of memory" in text
    ranks = lines(tmp_path / "rates" / "report" / "trials.csv")
    assert [line["trial"] for line in ranks][:3] == ["t2", "t3", "t1"]
    returns = [float(line[RETURN]) for line in ranks]
    assert returns == sorted(returns, reverse=True)
    assert [line["default"] for line in ranks] == ["0", "0", "1", "0", "0"]
    assert (tmp_path / "docs" / "rates" / "settings.png").is_file()


@pytest.mark.parametrize("metric", [RETURN, "eval_stochastic/element_quality"])
def test_a_search_that_completed_nothing_recommends_nothing(tmp_path: Path, metric: str):
    text = write(search(tmp_path / "rates", best=-20.0, metric=metric)).read_text()
    assert "No trial completed a mesh in the last tenth of its training" in text
    assert "best settings" not in text
    assert "The best of" not in text
    assert len(lines(tmp_path / "rates" / "report" / "trials.csv")) == 5


def test_what_was_completed_is_asked_of_the_metric_s_own_actions(tmp_path: Path):
    done = {"env_steps": 1, "eval_deterministic/completion_rate": 0.0, "eval_stochastic/completion_rate": 0.2}
    ranks = [Ranked(TrialResult("a", 1, "a", tmp_path, "finished", evaluations=[done]), {})]
    assert nothing_completed(ranks, "eval_deterministic/score")
    assert not nothing_completed(ranks, "eval_stochastic/score")


def test_a_search_without_the_default_says_so(tmp_path: Path):
    folder = search(tmp_path / "rates", default=False)
    assert not any(one.trial.default for one in ranking(read(folder)))
    assert "None of them has the default settings." in write(folder).read_text()


# ---- pictures --------------------------------------------------------------------------------------------------------


def test_a_variant_has_its_colour_in_every_panel_even_without_values(tmp_path: Path):
    x = np.arange(3.0)
    band, nothing = Interval(x, x - 1, x + 1), Interval(*[np.empty(0)] * 3)
    one = Panel({"a": (np.empty(0), nothing), "b": (x, band)}, "x", "y")
    two = Panel({"a": (x, band), "b": (x, band)}, "x", "y")
    figure = draw_bands([one, two], tmp_path / "bands.png", "Title")
    left, right = figure.axes
    assert left.lines[0].get_color() == right.lines[1].get_color() != right.lines[0].get_color()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "b"]
    assert figure.legends[0].get_title().get_text() == "Title"


def test_a_key_is_read_row_by_row(tmp_path: Path):
    x = np.arange(3.0)
    labels = [f"v{i}" for i in range(9)]
    figure = draw_bands([Panel({label: (x, Interval(x, x, x)) for label in labels}, "x", "y")], tmp_path / "bands.svg")
    figure.canvas.draw()
    boxes = {text.get_text(): text.get_window_extent() for text in figure.legends[0].get_texts()}
    assert sorted(boxes, key=lambda label: (-round(boxes[label].y0), boxes[label].x0)) == labels


@pytest.mark.parametrize(("first", "cut"), [(-1000.0, True), (0.0, False)])
def test_early_returns_far_below_all_others_do_not_flatten_the_curves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: float, cut: bool
):
    x, y = np.arange(9.0), np.array([first, 1.0, 3.0, 4.0, 5.0, 7.0, 6.0, 8.0, 9.0])
    band = SimpleNamespace(steps=x, iqm=Interval(y, y - 1.0, y + 1.0))
    drawn = []

    def draw(*given: object):
        drawn.append(draw_bands(*given))
        return drawn[-1]

    monkeypatch.setattr(pictures, "draw_bands", draw)
    pictures.curves(
        tmp_path, [SimpleNamespace(label="a", bands={RETURN: band, COMPLETION: band}, used=[0, 1])], "Title"
    )
    (figure,) = drawn
    bottom = figure.axes[0].get_ylim()[0]
    assert (bottom > first) == cut
    assert bottom < (y - 1.0)[4:].min()
    assert ("some early returns lie below" in figure.get_supxlabel()) == cut


def test_improvements_are_drawn_from_the_top_down(tmp_path: Path):
    pairs = [Pair("a", "b", {"r": Interval(*map(np.array, (0.8, 0.6, 0.9)))}),
             Pair("c", "d", {"r": Interval(*map(np.array, (0.5, 0.5, 0.5)))})]  # fmt: skip
    axes = draw_improvements(pairs, tmp_path / "pairs.svg").axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "c"]
    assert axes.get_ylim()[0] > axes.get_ylim()[1]
    assert axes.lines[-1].get_xdata().tolist() == [0.8, 0.5]


@pytest.mark.slow
def test_settings_that_span_decades_are_drawn_on_a_logarithmic_scale(tmp_path: Path):
    settings = {"rate": [1e-4, 1e-2], "tau": [0.1, 0.2], "kind": ["b", "a"]}
    figure = draw_settings(settings, np.array([1.0, np.nan]), tmp_path / "settings.png", "score", default=0)
    rate, tau, kind = figure.axes
    assert (rate.get_xscale(), tau.get_xscale()) == ("log", "linear")
    assert [label.get_text() for label in kind.get_xticklabels()] == ["a", "b"]


# ---- the command and what is wrong -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_prints_the_files(small: Path, capsys):
    assert command.main(["report", "small", "--studies", str(small.parent)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == str(small / "report" / "report.md")
    assert {Path(line).name for line in printed} >= {"curves.png", "curves.csv", "final.csv", "comparisons.csv"}
    assert all(Path(line).is_file() for line in printed)


def test_an_unknown_study_is_one_line_with_what_is_there(small: Path, capsys):
    assert command.main(["report", "smal", "--studies", str(small.parent)]) == BAD_INPUT
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "no such study" in error
    assert "there is small" in error


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("study.yaml", "[", "not valid YAML"),
        ("study.yaml", "settings: {}", "has no part `study`"),
        ("study.yaml", "study: {seeds: [a]}", "study.seeds: must be a list"),
        ("study.yaml", "study: {variants: [A]}", "study.variants: must be keys"),
        (
            "study.yaml",
            "study: {title: T, seeds: [1], variants: {A: }, expects: [A > C]}",
            "'A > C': write LABEL > LABEL",
        ),
        (
            "study.yaml",
            "study: {title: T, seeds: [1], variants: {A: }, expects: [A = B]}",
            "'A = B': write LABEL > LABEL or LABEL = LABEL",
        ),
        ("trials.json", "{", "is not a list of trials"),
        ("trials.json", "[1]", "is not a list of trials"),
        ("trials.json", '[{"label": "A", "seed": 1, "run": "r", "status": "lost"}]', "status 'lost' is none of"),
        ("trials.json", "[]", "no trial yet"),
    ],
)
def test_what_is_wrong_is_one_line_with_the_file(small: Path, file: str, text: str, told: str):
    (small / file).write_text(text)
    with pytest.raises((ConfigError, StudyError)) as caught:
        write(small)
    assert str(small / file) in str(caught.value)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (small / "report").exists()


def test_nothing_can_be_written_to_a_file_in_the_way(small: Path):
    (small / "report").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        write(small)


def test_the_machine_is_named(tmp_path: Path):
    described = tmp_path / "cpuinfo"
    described.write_text("processor\t: 0\nmodel name\t: A Fine Processor\n")
    assert model(described) == "A Fine Processor"
    assert model(tmp_path / "none")
    assert re.match(r"\d+ CPU cores? \(.+\), \w+$", machine())
